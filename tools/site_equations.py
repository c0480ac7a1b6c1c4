# SPDX-License-Identifier: Apache-2.0
"""A hook of mkdocs: fences of `math` become MathML, which browsers set without a script."""

import re
from typing import Any

from latex2mathml.converter import convert

FENCE = re.compile(r'^```math\n(.*?)\n```$', re.MULTILINE | re.DOTALL)


def on_page_markdown(markdown: str, **_: Any) -> str:
    """The page with its equations set."""
    return FENCE.sub(lambda fence: convert(' '.join(fence[1].split()), display='block'), markdown)
