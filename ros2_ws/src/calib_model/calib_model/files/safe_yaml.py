# SPDX-License-Identifier: Apache-2.0
"""YAML from anybody, read without harm: no type that is not plain, no text that stands for more."""

from __future__ import annotations

import re
from typing import Any

import yaml

from calib_model.errors import DescriptionError

LARGEST_TEXT = 200_000  # characters; PyYAML takes seconds for that many
DEEPEST = 1000  # levels that the loader in C may go down: some hundred kilobytes of its stack
_OTHERWISE = re.compile(r'[-+]?(?:0[0-9_]+|(?P<sixty>[0-9][0-9_]*(?::[0-5]?[0-9])+(?:\.[0-9_]*)?))')
LONGEST_VALUE = 10_000  # characters: some are numbers, and cost the square of it


def load_plain(text: str, source: str, largest: int = LARGEST_TEXT, as_meant: bool = False) -> Any:
    """The content of a YAML text of `largest` characters at most: mappings, lists and scalars.

    With `as_meant` numbers are refused that YAML reads in another way than people do: 022, which
    is 18, and 1:30, which is 90.

    Raises:
        DescriptionError: not YAML, too large, nested too deep, a key that is there twice, or it
            uses aliases or tags; or such a number.
    """
    if len(text) > largest or (len(text) > LARGEST_TEXT and not _shallow(text)):
        raise DescriptionError(source, '', f'larger than {largest} characters')
    try:
        _refuse_aliases_and_tags(text, source)
        return _load(text, _LoaderAsMeant if as_meant else _Loader)
    except _NotAsMeantError as error:
        raise DescriptionError(source, f'line {error.line}', str(error)) from None
    except yaml.YAMLError as error:
        mark = getattr(error, 'problem_mark', None)
        where = f'line {mark.line + 1}' if mark is not None else ''
        problem = getattr(error, 'problem', None) or 'not YAML'
        raise DescriptionError(source, where, f'not valid YAML: {problem}') from error
    except (RecursionError, ValueError) as error:
        raise DescriptionError(source, '', f'not usable YAML: {type(error).__name__}') from error


def _refuse_aliases_and_tags(text: str, source: str) -> None:
    """Aliases make a small text stand for a huge value, tags ask for types that are not ours."""
    if '*' not in text and '!' not in text:
        return
    for token in yaml.scan(text):
        if isinstance(token, yaml.AliasToken | yaml.TagToken):
            kind = 'aliases' if isinstance(token, yaml.AliasToken) else 'tags'
            where = f'line {token.start_mark.line + 1}'
            raise DescriptionError(source, where, f'YAML {kind} are not supported here')


def _shallow(text: str) -> bool:
    """Whether a text cannot be nested deeper than DEEPEST: the loader in C has no other guard of
    the stack. Brackets within strings count too, and cost but time."""
    in_flow, in_blocks = text.count('[') + text.count('{'), 0
    for line in text.splitlines():
        content = line.lstrip(' ')
        compact = content.count('- ') + content.count('? ') + content.count(': ')
        in_blocks = max(in_blocks, len(line) - len(content) + compact)
    return in_flow + in_blocks < DEEPEST


class _Loader(yaml.SafeLoader):
    """YAML proper: of a key that is there twice, PyYAML takes the last without a word."""

    def construct_scalar(self, node: Any) -> Any:
        if len(node.value) > LONGEST_VALUE:
            problem = f'a value of {len(node.value)} characters'
            raise yaml.constructor.ConstructorError(None, None, problem, node.start_mark)
        return super().construct_scalar(node)

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen = set()
        for key, _ in node.value:
            name = key.value if isinstance(key, yaml.ScalarNode) else id(key)
            if name in seen:
                problem = f'key {key.value!r} is there twice'
                raise yaml.constructor.ConstructorError(None, None, problem, key.start_mark)
            seen.add(name)
        return super().construct_mapping(node, deep)


class _NotAsMeantError(Exception):
    """A number that YAML reads otherwise than people; in `line`."""

    def __init__(self, problem: str, line: int) -> None:
        super().__init__(problem)
        self.line = line


class _LoaderAsMeant(_Loader):
    """Refuses plain scalars that are numbers in base 8 or 60 to YAML, and those that begin with a
    zero like these: 089 would be text."""

    def construct_scalar(self, node: Any) -> Any:
        if not node.style and (found := _OTHERWISE.fullmatch(node.value)):
            why = 'counts in 60s' if found['sixty'] else 'counts in 8s after a leading zero'
            problem = (
                f'{node.value[:40]} is read as people do not, as YAML {why}: write the number '
                'in full, or text in quotes'
            )
            raise _NotAsMeantError(problem, node.start_mark.line + 1)
        return super().construct_scalar(node)


def _load(text: str, kind: type[_Loader]) -> Any:
    """The text parsed in C where PyYAML has that, ten times as fast, and where its nesting leaves
    the stack alone; what becomes of the nodes is that of `kind` in either case."""
    if not _shallow(text) or not yaml.__with_libyaml__:
        return yaml.load(text, kind)
    node = yaml.compose(text, yaml.CSafeLoader)
    loader = kind('')
    return None if node is None else loader.construct_document(node)
