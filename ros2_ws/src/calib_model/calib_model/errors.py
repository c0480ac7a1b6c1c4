# SPDX-License-Identifier: Apache-2.0
"""What can go wrong, in one family: the edge turns these into exit code 2 or `success: false`."""


class CalibrationError(Exception):
    """Anything that keeps a calibration from being done; its text is one line for the user."""

    def __str__(self) -> str:
        return ' '.join(super().__str__().split())


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
