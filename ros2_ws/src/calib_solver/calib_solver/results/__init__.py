# SPDX-License-Identifier: Apache-2.0
"""result.json and the files beside it."""

from typing import TYPE_CHECKING

from calib_model.lazy import lazily

if TYPE_CHECKING:
    from calib_solver.results.diagnostics import (
        prior_words as prior_words,
        scale_words as scale_words,
    )
    from calib_solver.results.files import (
        Corrected as Corrected,
        convention_words as convention_words,
        probe_fit_record as probe_fit_record,
        refuse_no_place as refuse_no_place,
        result_record as result_record,
        transform_record as transform_record,
        write_results as write_results,
    )
    from calib_solver.results.info import (
        Info as Info,
        parse_info as parse_info,
    )
    from calib_solver.results.limits import (
        LIMITED as LIMITED,
        Judged as Judged,
        checked_limits as checked_limits,
        judge as judge,
        limits_of as limits_of,
        parse_limits as parse_limits,
    )
    from calib_solver.results.points import (
        point_quality_record as point_quality_record,
        point_result_record as point_result_record,
    )
    from calib_solver.results.quality import (
        LEFT_OUT_WORDS as LEFT_OUT_WORDS,
        Record as Record,
        left_out_words as left_out_words,
        quality_record as quality_record,
        sphere_records as sphere_records,
    )
    from calib_solver.results.readings import (
        reading_times as reading_times,
        readings_record as readings_record,
    )
    from calib_solver.results.resampling import (
        resampling_lines as resampling_lines,
    )
    from calib_solver.results.uncertainty import (
        StatedErrors as StatedErrors,
        needed_content as needed_content,
        read_uncertainty as read_uncertainty,
    )
else:
    __getattr__, __dir__, __all__ = lazily(__name__, __file__)
