# SPDX-License-Identifier: Apache-2.0
"""Notes every file that a Python process opens; Python imports this by itself from PYTHONPATH.

One file per process in $OPENED_FILES: the process's arguments, then a path a line.
"""

import os
import sys

_folder = os.environ.get('OPENED_FILES')
if _folder:
    _log = os.open(os.path.join(_folder, f'{os.getpid()}.txt'), os.O_WRONLY | os.O_CREAT, 0o600)
    os.write(_log, (' '.join(sys.orig_argv) + '\n').encode())

    def _note(event, arguments):
        if event == 'open' and isinstance(arguments[0], (str, bytes)):
            os.write(_log, os.fsencode(arguments[0]) + b'\n')

    sys.addaudithook(_note)
