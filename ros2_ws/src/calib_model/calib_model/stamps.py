# SPDX-License-Identifier: Apache-2.0
"""Stamps: whole nanoseconds, as in every message and bag."""

SECOND = 1_000_000_000  # ns
#: whose time messages have: the headers' where it tells, the headers' or the recording's always
TIMED_BY = ('auto', 'header', 'record')
TIMED_BY_TOLD = (
    "header: what the messages' headers say counts; record: when they were recorded; "
    'auto (default): the latter where headers tell no time'
)
