# SPDX-License-Identifier: Apache-2.0
"""How the report looks: light, dark and on paper, from a telephone to a desk."""

from __future__ import annotations

#: CSS of the page; a series' role is the class that gives it colour
STYLE = """
:root { color-scheme: light dark; --paper: #fff; --ink: #1c2126; --faint: #5d6771;
  --rule: #dce0e4; --warn: #fff4d6; --warn-rule: #d9a514; --good: #22866a; --good-paper: #e3f3ec;
  --bad: #b3261e; --bad-paper: #fbe4e2; --before: #8b9196; --after: #0b62a4;
  --held: #c4590a; --x: #0b62a4; --y: #22866a; --z: #a33f87; --level1: #86b6dc;
  --level2: #5f9fd0; --level3: #2a78b5; --level4: #c4590a; --level5: #8d1f1f; }
@media (prefers-color-scheme: dark) { :root { --paper: #15181b; --ink: #e6e8ea;
  --faint: #a3acb4; --rule: #353b41; --warn: #38300f; --warn-rule: #c99a1c;
  --good: #5fcfa9; --good-paper: #15332a; --bad: #ff8a80; --bad-paper: #3d1a18; --before: #7b838b;
  --after: #5ab0f0; --held: #f2a25c; --x: #5ab0f0; --y: #5fcfa9; --z: #e58fce;
  --level1: #2f5d82; --level2: #3d86bd; --level3: #6cbaf2; --level4: #f2a25c;
  --level5: #ff7b7b; } }
* { box-sizing: border-box; }
body { margin: 0 auto; padding: 2rem 1.25rem 3rem; max-width: 66rem; background: var(--paper);
  color: var(--ink); font: 15px/1.5 system-ui, -apple-system, 'Segoe UI', 'Liberation Sans',
  Arial, sans-serif; overflow-wrap: break-word; }
h1 { font-size: 1.75rem; line-height: 1.2; margin: 0 0 .3rem; letter-spacing: -.01em; }
h2 { font-size: 1.2rem; margin: 2.6rem 0 .6rem; padding-top: .7rem;
  border-top: 1px solid var(--rule); }
h3 { font-size: 1rem; margin: 1.4rem 0 .3rem; }
p { margin: .45rem 0; max-width: 46rem; } .faint, .says { color: var(--faint); }
.kind { margin: 0 0 .2rem; color: var(--faint); font-size: .85rem; letter-spacing: .06em;
  text-transform: uppercase; }
.warnings { margin: 1.2rem 0; padding: .6rem 1rem .8rem; background: var(--warn);
  border-left: 4px solid var(--warn-rule); }
.warnings h2 { margin: 0; padding: 0; border: 0; font-size: 1rem; }
.warnings ul { margin: .3rem 0 0; padding-left: 1.2rem; } .warnings li { margin: .2rem 0; }
.verdict { margin: 1.2rem 0; padding: .6rem 1rem; border-left: 4px solid var(--good);
  background: var(--good-paper); font-size: 1.05rem; }
.verdict.bad { border-color: var(--bad); background: var(--bad-paper); }
.scroll { overflow-x: auto; margin: .8rem 0; }
table { border-collapse: collapse; width: 100%; font-size: .93rem; }
caption { text-align: left; color: var(--faint); padding: 0 0 .35rem; }
th, td { text-align: left; font-weight: normal; padding: .28rem .9rem .28rem 0;
  border-bottom: 1px solid var(--rule); vertical-align: baseline; }
thead th { color: var(--faint); border-bottom: 1px solid var(--ink); vertical-align: bottom; }
tbody th { white-space: nowrap; }
td:last-child, th:last-child { padding-right: 0; }
.number { text-align: right; font-variant-numeric: tabular-nums; }
.key-figures td.number { font-size: 1.1rem; } .best { font-weight: 600; }
.words { min-width: 15rem; } td.mono { font-family: ui-monospace, 'Liberation Mono', monospace;
  font-size: .82rem; overflow-wrap: anywhere; min-width: 17rem; }
tr.part th { padding-top: .9rem; font-weight: 600; }
table.narrow { width: auto; } .narrow th, .narrow td { padding-right: 2rem; }
.facts th { color: var(--faint); width: 11rem; white-space: normal; }
.charts { display: grid; grid-template-columns: repeat(auto-fill, minmax(min(100%, 27rem), 1fr));
  gap: 1.6rem 1.6rem; margin: 1rem 0; }
.charts.three { grid-template-columns: repeat(auto-fill, minmax(min(100%, 17rem), 1fr)); }
figure { margin: 0; min-width: 0; } figcaption { font-size: .93rem; }
figcaption b { font-weight: 600; }
.says { font-size: .83rem; margin: 0; } .keys { display: block; }
svg { display: block; width: 100%; height: auto; margin-top: .2rem; overflow: visible; }
svg text { fill: var(--faint); font: 11px system-ui, 'Liberation Sans', Arial, sans-serif; }
svg text.note { fill: var(--ink); }
.grid { stroke: var(--rule); stroke-width: 1; fill: none; }
.marks, .fine { fill: none; stroke-linecap: round; stroke-width: 5.4; }
.fine { stroke-width: 2.6; stroke-opacity: .6; }
.names circle { fill: transparent; }
.line { fill: none; stroke-width: 1.7; stroke-linejoin: round; }
.marks.held, .marks.y { stroke-linecap: square; stroke-width: 4.6; }
.marks.z { fill: var(--z); stroke: none; }
.before { stroke: var(--before); } .after { stroke: var(--after); } .held { stroke: var(--held); }
.x { stroke: var(--x); } .y { stroke: var(--y); } .z { stroke: var(--z); }
.level1 { stroke: var(--level1); } .level2 { stroke: var(--level2); }
.level3 { stroke: var(--level3); } .level4 { stroke: var(--level4); }
.level5 { stroke: var(--level5); }
.key { margin-right: .9em; color: var(--faint); white-space: nowrap; font-size: .87rem; }
.key::before { content: ''; display: inline-block; width: .62em; height: .62em;
  margin-right: .35em; border-radius: 50%; background: var(--after); }
.key.before::before { background: var(--before); } .key.held::before { background: var(--held);
  border-radius: 0; } .key.x::before { background: var(--x); }
.key.y::before { background: var(--y); border-radius: 0; }
.key.z::before { background: var(--z); border-radius: 0;
  clip-path: polygon(50% 0, 100% 100%, 0 100%); }
.key.level1::before { background: var(--level1); }
.key.level2::before { background: var(--level2); }
.key.level3::before { background: var(--level3); }
.key.level4::before { background: var(--level4); }
.key.level5::before { background: var(--level5); }
.sign { display: grid; grid-template-columns: repeat(auto-fit, minmax(12rem, 1fr)); gap: 2rem;
  margin-top: 3.2rem; } .sign div { border-top: 1px solid var(--ink); padding-top: .3rem;
  color: var(--faint); font-size: .85rem; }
@media (max-width: 34rem) { body { padding: 1.2rem 1rem 2rem; } h1 { font-size: 1.4rem; }
  .wide svg text, .view svg text { font-size: 14.5px; } .facts th { width: 6.5rem; }
  th, td { padding-right: .45rem; } tbody th { white-space: normal; }
  .key-figures td.number { font-size: .84rem; }
  table { font-size: .84rem; } thead th { font-size: .78rem; }
  .narrow th, .narrow td { padding-right: .7rem; } .words { min-width: 21rem; } }
@page { margin: 16mm 14mm; }
@media print { :root { color-scheme: light; --paper: #fff; --ink: #000; --faint: #444;
  --rule: #c4c8cc; --warn: #fff4d6; --warn-rule: #d9a514; --good: #22866a; --good-paper: #e3f3ec;
  --bad: #b3261e; --bad-paper: #fbe4e2; --before: #8b9196; --after: #0b62a4;
  --held: #c4590a; --x: #0b62a4; --y: #22866a; --z: #a33f87; --level1: #86b6dc;
  --level2: #5f9fd0; --level3: #2a78b5; --level4: #c4590a; --level5: #8d1f1f; }
  body { max-width: none; padding: 0; font-size: 9.5pt; print-color-adjust: exact;
    -webkit-print-color-adjust: exact; }
  h2, h3, caption { break-after: avoid; } figure, tr, .warnings, .sign { break-inside: avoid; }
  thead { display: table-header-group; } .scroll { overflow: visible; }
  .charts { grid-template-columns: 1fr 1fr; } .charts.three { grid-template-columns: 1fr 1fr 1fr; }
  tbody th { white-space: normal; }
  th, td { padding-right: .5rem; } .narrow th, .narrow td { padding-right: 1.5rem; }
  .words, td.mono { min-width: 0; } td.mono { font-size: 7.5pt; } }
"""
