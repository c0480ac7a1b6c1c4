# SPDX-License-Identifier: Apache-2.0
"""Stamps: whole nanoseconds, as in every message and bag."""

SECOND = 1_000_000_000  # ns
#: whose time messages have: the headers' where it tells, the headers' or the recording's always
TIMED_BY = ('auto', 'header', 'record')
