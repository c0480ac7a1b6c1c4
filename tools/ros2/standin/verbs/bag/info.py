# SPDX-License-Identifier: Apache-2.0
"""Print information about a bag to the screen."""

import argparse
import time
from pathlib import Path
from typing import Any

import yaml

from ...command_line import Refusal

SECOND = 1_000_000_000  # ns

EXAMPLE = 'ros2 bag info bags/demo/identification'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('bag_path', help='Bag to open')


def main(args: argparse.Namespace) -> None:
    folder = Path(args.bag_path)
    folder = folder if folder.is_dir() else folder.parent
    print(description(folder, metadata(Path(args.bag_path), folder)))


def metadata(bag: Path, folder: Path) -> dict[str, Any]:
    """What stands in metadata.yaml beside the recording.

    Raises:
        Refusal: it is missing or is not what rosbag2 writes.
    """
    if not bag.exists():
        raise Refusal(f"[ros2bag]: error: Bag path '{bag}' does not exist!")
    path = folder / 'metadata.yaml'
    try:
        return dict(yaml.safe_load(path.read_text())['rosbag2_bagfile_information'])
    except OSError as error:
        raise Refusal(f'{path}: {error.strerror}') from None
    except (yaml.YAMLError, KeyError, TypeError, ValueError):
        raise Refusal(f"{path}: no mapping under 'rosbag2_bagfile_information'") from None


def description(folder: Path, info: dict[str, Any]) -> str:
    files = info['relative_file_paths']
    start = info['starting_time']['nanoseconds_since_epoch']
    length = info['duration']['nanoseconds']
    size = sum((folder / name).stat().st_size for name in files if (folder / name).is_file())
    rows = [
        ('Files:', f'\n{"":19}'.join(files)),
        ('Bag size:', readable(size)),
        ('Storage id:', info['storage_identifier']),
        ('ROS Distro:', info.get('ros_distro') or 'unknown'),
        ('Duration:', f'{length // SECOND}.{length % SECOND:09d}s'),
        ('Start:', moment(start)),
        ('End:', moment(start + length)),
        ('Messages:', str(info['message_count'])),
        ('Topic information:', f'\n{"":19}'.join(map(topic, info['topics_with_message_count']))),
    ]
    return '\n' + '\n'.join(f'{label:<19}{value}' for label, value in rows) + '\n'


def topic(entry: dict[str, Any]) -> str:
    about = entry['topic_metadata']
    return (
        f'Topic: {about["name"]} | Type: {about["type"]} | Count: {entry["message_count"]} | '
        f'Serialization Format: {about["serialization_format"]}'
    )


def readable(size: float) -> str:
    for unit in ('B', 'KiB', 'MiB'):
        if size < 1024:
            return f'{size:.0f} B' if unit == 'B' else f'{size:.1f} {unit}'
        size /= 1024
    return f'{size:.1f} GiB'


def moment(nanoseconds: int) -> str:
    seconds, rest = divmod(nanoseconds, SECOND)
    written = time.strftime('%b %e %Y %H:%M:%S', time.localtime(seconds))
    return f'{written}.{rest:09d} ({seconds}.{rest:09d})'
