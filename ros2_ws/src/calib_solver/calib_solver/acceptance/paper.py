# SPDX-License-Identifier: Apache-2.0
"""A page on paper: PDF by a headless Chromium, where the machine has one."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from pathlib import Path

from calib_model.errors import CalibrationError

NAMES = ('chromium', 'chromium-browser', 'google-chrome', 'google-chrome-stable')
PAPERS = ('A4', 'Letter')
SWITCHES = (
    '--headless',
    '--no-sandbox',
    '--disable-gpu',
    '--disable-dev-shm-usage',
    '--disable-extensions',
    '--no-first-run',
    '--no-pdf-header-footer',
)
PATIENCE = 120.0  # s


def browser() -> str:
    """The browser's path; the variable CHROMIUM names another.

    Raises:
        CalibrationError: there is none; says how to get one.
    """
    named = os.environ.get('CHROMIUM')
    found = named or next(filter(None, map(shutil.which, NAMES)), None)
    if found is None:
        raise CalibrationError(
            'PDF: no Chromium on this machine (Debian: apt-get install chromium; Ubuntu: snap '
            'install chromium), or print report.html from any browser'
        )
    return found


def as_pdf(page: str, paper: str) -> bytes:
    """An HTML page as PDF on `paper`, one of PAPERS.

    Raises:
        CalibrationError: there is no browser, or it makes no PDF.
    """
    program = browser()
    sized = page.replace('</style>', f'@page {{ size: {paper}; }}</style>', 1)
    with tempfile.TemporaryDirectory(prefix='report-', ignore_cleanup_errors=True) as folder:
        source, out = Path(folder) / 'report.html', Path(folder) / 'report.pdf'
        source.write_text(sized, encoding='utf-8')
        words = [program, *SWITCHES, f'--user-data-dir={folder}/profile']
        words += [f'--print-to-pdf={out}', source.as_uri()]
        try:
            subprocess.run(words, capture_output=True, timeout=PATIENCE, check=True)
            return out.read_bytes()
        except subprocess.TimeoutExpired as error:
            raise CalibrationError(f'PDF: {program} took more than {PATIENCE:g} s') from error
        except (OSError, subprocess.CalledProcessError) as error:
            raise CalibrationError(f'PDF: {program} made none: {error}') from error
