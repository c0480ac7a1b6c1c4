# SPDX-License-Identifier: Apache-2.0
"""What pip is configured to, for uv, which does not read that: `pip config list` on stdin, lines
`VARIABLE=value` on stdout."""

import ast
import sys

VARIABLES = {
    'cert': 'SSL_CERT_FILE',
    'default-timeout': 'UV_HTTP_TIMEOUT',
    'extra-index-url': 'UV_INDEX',
    'find-links': 'UV_FIND_LINKS',
    'index-url': 'UV_DEFAULT_INDEX',
    'no-index': 'UV_OFFLINE',  # of the same effect where wheels lie in a folder
    'proxy': 'ALL_PROXY',
    'timeout': 'UV_HTTP_TIMEOUT',
    'trusted-host': 'UV_INSECURE_HOST',
}
#: a list in a variable: uv separates some by commas
COMMA = {'UV_FIND_LINKS'}


def variables(lines: list[str]) -> dict[str, str]:
    """The environment for uv; what pip takes from its own environment goes before files."""
    found = {}
    for line in sorted(lines, key=lambda each: each.startswith(':env:')):
        key, _, value = line.strip().partition('=')
        name = VARIABLES.get(key.rpartition('.')[2])
        if name:
            words = ast.literal_eval(value).split()
            found[name] = (',' if name in COMMA else ' ').join(words)
    return found


if __name__ == '__main__':
    for name, value in variables(sys.stdin.readlines()).items():
        print(f'{name}={value}')
