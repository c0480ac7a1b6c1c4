# SPDX-License-Identifier: Apache-2.0
"""What every test of every package needs."""

import signal

# A shell that starts pytest in the background makes it ignore Ctrl-C, and so would every process
# that a test starts and then interrupts.
signal.signal(signal.SIGINT, signal.default_int_handler)
