# SPDX-License-Identifier: Apache-2.0
"""Play back a bag on its topics."""

import argparse

from ..run import start

EXAMPLE = 'ros2 bag play bags/demo/identification --rate 10'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('bag_path', help='Bag to open')
    parser.add_argument(
        '-r', '--rate', type=float, default=1.0, help='Rate at which to play back messages'
    )
    parser.add_argument(
        '-l', '--loop', action='store_true', help='Loop playback when the end of the bag is reached'
    )
    parser.add_argument(
        '--clock', type=float, nargs='?', const=40.0, metavar='HZ', help='Publish to /clock'
    )


def main(args: argparse.Namespace) -> None:
    words = [args.bag_path, '--rate', str(args.rate)]
    words += ['--loop'] * args.loop + ['--clock'] * (args.clock is not None)
    start('calib_capture', 'replay', words, [])
