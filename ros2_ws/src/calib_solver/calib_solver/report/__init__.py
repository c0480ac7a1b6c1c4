# SPDX-License-Identifier: Apache-2.0
"""report.html and its charts, and the same as PNG files."""

from typing import TYPE_CHECKING

from calib_model.lazy import lazily

if TYPE_CHECKING:
    from calib_solver.report.charts import (
        Band as Band,
        Chart as Chart,
        Series as Series,
    )
    from calib_solver.report.cover import (
        days as days,
    )
    from calib_solver.report.evidence import (
        EVIDENCE as EVIDENCE,
        evidence_of as evidence_of,
        evidence_text as evidence_text,
    )
    from calib_solver.report.html import (
        UNITS as UNITS,
        decimals_of as decimals_of,
        document as document,
        heading as heading,
        mm as mm,
        number as number,
        paragraph as paragraph,
        section as section,
        side_by_side as side_by_side,
        table as table,
        two_digits as two_digits,
        verdict_box as verdict_box,
    )
    from calib_solver.report.instruments import (
        Inputs as Inputs,
    )
    from calib_solver.report.page import (
        report_html as report_html,
    )
    from calib_solver.report.png import (
        save_figures as save_figures,
        save_point_figures as save_point_figures,
    )
    from calib_solver.report.points import (
        point_evidence_of as point_evidence_of,
    )
else:
    __getattr__, __dir__, __all__ = lazily(__name__, __file__)
