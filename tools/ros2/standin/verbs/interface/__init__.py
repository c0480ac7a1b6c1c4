# SPDX-License-Identifier: Apache-2.0
"""Messages, services and actions."""
