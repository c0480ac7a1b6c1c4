# SPDX-License-Identifier: Apache-2.0
"""What can go wrong, in one family: the edge turns these into exit code 2 or `success: false`."""

LONGEST_LINE = 1000  # characters: names come from files, and may be of any length


def printable(text: str) -> str:
    """The text in one line, with nothing in it that a terminal obeys."""
    return ''.join(sign if sign.isprintable() else '\ufffd' for sign in ' '.join(text.split()))


class CalibrationError(Exception):
    """Anything that keeps a calibration from being done; its text is one line for the user, with
    nothing in it that a terminal obeys."""

    def __str__(self) -> str:
        line = ' '.join(super().__str__().split())
        if len(line) > LONGEST_LINE:
            line = f'{line[: LONGEST_LINE // 2]} ... {line[-LONGEST_LINE // 2 :]}'
        return printable(line)


class DescriptionError(CalibrationError):
    """An arm, probe or gauge description that cannot be used."""

    def __init__(self, source: str, where: str, problem: str) -> None:
        place = f'{source}: {where}' if where else source
        super().__init__(f'{place}: {problem}')
        self.source = source
        self.where = where


class BagError(CalibrationError):
    """A bag that is missing, damaged, or lacks what was asked of it."""


class TableError(CalibrationError):
    """A table of probing poses with a row or a column that cannot be used."""


class DataError(CalibrationError):
    """Measurements that do not fit the arm, the probe or the gauge they are said to come from."""


class RankError(CalibrationError):
    """Measurements that leave what was asked for undetermined."""


class FitError(CalibrationError):
    """A fit that ended worse than it began."""


class ContactError(CalibrationError):
    """Stylus readings or sphere centres for which the contact has no solution."""


class ParameterError(CalibrationError):
    """A parameter or an argument of a node that cannot be used."""
