# SPDX-License-Identifier: Apache-2.0
"""YAML from anybody, read without harm: no type that is not plain, no text that stands for more."""

from __future__ import annotations

from typing import Any

import yaml

from calib_model.errors import DescriptionError

LARGEST_TEXT = 200_000  # characters; PyYAML takes seconds for that many
LONGEST_VALUE = 10_000  # characters: some are numbers, and cost the square of it


def load_plain(text: str, source: str) -> Any:
    """The content of a YAML text: mappings, lists and scalars.

    Raises:
        DescriptionError: not YAML, too large, nested too deep, a key that is there twice, or it
            uses aliases or tags.
    """
    if len(text) > LARGEST_TEXT:
        raise DescriptionError(source, '', f'larger than {LARGEST_TEXT} characters')
    try:
        _refuse_aliases_and_tags(text, source)
        return yaml.load(text, _Loader)  # a SafeLoader
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
