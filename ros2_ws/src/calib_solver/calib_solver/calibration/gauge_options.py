# SPDX-License-Identifier: Apache-2.0
"""What a command line says of the gauge, beside what the bags say."""

from __future__ import annotations

from argparse import Namespace

from calib_model import bags
from calib_model.bounds import TEMPERATURE
from calib_model.command_line import CommandParser, number_from


def add_gauge_arguments(parser: CommandParser) -> None:
    """The options of the gauge's certificate and its temperature."""
    parser.add_argument(
        '--gauge', default='', metavar='YAML', help="use this certificate, not the bag's"
    )
    parser.add_argument(
        '--temperature',
        type=number_from(*TEMPERATURE),
        metavar='C',
        help="of the gauge, deg C, not the bag's: its certified lengths are taken there",
    )
    parser.add_argument(
        '--temperature-uncertainty',
        type=number_from(0.0, 100.0),
        default=0.0,
        metavar='K',
        help='standard uncertainty of --temperature (default: %(default)s)',
    )


def given_temperature(given: Namespace) -> bags.Temperature | None:
    """The gauge's temperature, None where it was not given."""
    if given.temperature is None:
        return None
    return bags.Temperature(given.temperature, given.temperature_uncertainty)
