# SPDX-License-Identifier: Apache-2.0
"""How long an arm is to stand for a pose, as its description may say: the key `standing`."""

from __future__ import annotations

from dataclasses import astuple, dataclass

from calib_model.descriptions.text import yaml_text
from calib_model.files import load_mapping

KEY = 'standing'
LONGEST = 60.0  # s


@dataclass(frozen=True)
class Standing:
    """Seconds: still for `settle`, then read for `dwell`, and held for `rest` beyond that.

    The defaults suit a real arm, which swings for a while after it has stopped.
    """

    settle: float = 0.3
    dwell: float = 0.5
    rest: float = 0.1

    @property
    def hold(self) -> float:
        """All of it, s."""
        return self.settle + self.dwell + self.rest


#: of a simulated arm, which does not swing
SIMULATED = Standing(0.01, 0.03, 0.02)


def parse_standing(text: str, source: str = 'arm description') -> Standing | None:
    """What an arm's YAML text says of it, None where it says nothing.

    Raises:
        DescriptionError: a value is of the wrong kind, or out of range.
    """
    top = load_mapping(text, source, (KEY, 'name'))
    if KEY not in top:
        return None
    default = Standing()
    row = top.mapping(KEY, ('settle', 'dwell', 'rest'))
    found = Standing(
        row.number('settle', default.settle),
        row.number('dwell', default.dwell),
        row.number('rest', default.rest),
    )
    if min(astuple(found)) < 0 or max(astuple(found)) > LONGEST or not found.dwell:
        raise top.refuse(KEY, f'expected s from 0 to {LONGEST:g}, and a dwell above zero')
    return found


def standing_yaml(standing: Standing) -> str:
    """The lines that say so in the description of an arm."""
    settle, dwell, rest = astuple(standing)
    return yaml_text({KEY: {'settle': settle, 'dwell': dwell, 'rest': rest}})
