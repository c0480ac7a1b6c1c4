# SPDX-License-Identifier: Apache-2.0
"""What a bag's files hold, and the metadata.yaml that rosbag2 writes of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import yaml

from calib_model.bags import cdr
from calib_model.topics import Topic


@dataclass(frozen=True)
class Definition:
    """How a topic introduces itself in a bag: `schema` is the text of its type.

    `offered_qos` are the profiles as in metadata.yaml. The channel's text is made of the same
    object: readers drop topics where the two differ.
    """

    topic: str
    type: str
    schema: bytes
    encoding: str = 'ros2msg'
    offered_qos: list[dict[str, Any]] = field(default_factory=list)
    type_hash: str = ''
    message_encoding: str = 'cdr'

    @property
    def channel(self) -> tuple[str, str, str]:
        """What makes it a channel of its own."""
        return self.topic, self.type, self.message_encoding

    @staticmethod
    def of(topic: Topic) -> Definition:
        """That of a topic of the suite."""
        return Definition(
            topic.name,
            topic.type,
            cdr.schema_text(topic.type),
            offered_qos=topic.offered_qos(),
            type_hash=cdr.type_hash(topic.type),
        )

    def channel_metadata(self) -> dict[str, str]:
        """What rosbag2 puts beside a channel."""
        qos = yaml.safe_dump(self.offered_qos, sort_keys=False)
        return {'offered_qos_profiles': qos, 'topic_type_hash': self.type_hash}


@dataclass
class FileAccount:
    """One MCAP file of a bag: first and last log time (ns) and the messages of each topic."""

    name: str
    first: int = 0
    last: int = 0
    definitions: dict[str, Definition] = field(default_factory=dict)
    counts: dict[str, int] = field(default_factory=dict)

    @property
    def messages(self) -> int:
        """How many messages it holds."""
        return sum(self.counts.values())

    def add(self, topic: str, time: int) -> None:
        """Take note of one message."""
        self.first = min(self.first, time) if self.counts else time
        self.last = max(self.last, time) if self.counts else time
        self.counts[topic] = self.counts.get(topic, 0) + 1


def metadata_yaml(files: Sequence[FileAccount]) -> str:
    """The text of metadata.yaml, version 9, of a bag of these files."""
    filled = [file for file in files if file.messages]
    first = min((file.first for file in filled), default=0)
    last = max((file.last for file in filled), default=0)
    definitions = {key: each for file in files for key, each in file.definitions.items()}
    information = {
        'version': 9,
        'storage_identifier': 'mcap',
        'duration': {'nanoseconds': last - first},
        'starting_time': {'nanoseconds_since_epoch': first},
        'message_count': sum(file.messages for file in files),
        'topics_with_message_count': [
            _topic_row(each, sum(file.counts.get(each.topic, 0) for file in files))
            for each in definitions.values()
        ],
        'compression_format': '',
        'compression_mode': '',
        'relative_file_paths': [file.name for file in files],
        'files': [_file_row(file) for file in files],
        'custom_data': None,
        'ros_distro': 'jazzy',
    }
    text: str = yaml.dump(
        {'rosbag2_bagfile_information': information}, Dumper=_Plain, sort_keys=False, width=1000
    )
    return text


class _Plain(yaml.SafeDumper):
    """Writes out what occurs twice: rosbag2's reader knows no aliases."""

    def ignore_aliases(self, _: Any) -> bool:
        return True


def _topic_row(definition: Definition, count: int) -> dict[str, Any]:
    described = {
        'name': definition.topic,
        'type': definition.type,
        'serialization_format': definition.message_encoding,
        'offered_qos_profiles': definition.offered_qos,
        'type_description_hash': definition.type_hash,
    }
    return {'topic_metadata': described, 'message_count': count}


def _file_row(file: FileAccount) -> dict[str, Any]:
    return {
        'path': file.name,
        'starting_time': {'nanoseconds_since_epoch': file.first},
        'duration': {'nanoseconds': file.last - file.first},
        'message_count': file.messages,
    }
