# SPDX-License-Identifier: Apache-2.0
"""The YAML files of arm, probe, gauge, placements, links and corrections."""

from typing import TYPE_CHECKING

from calib_model.lazy import lazily

if TYPE_CHECKING:
    from calib_model.descriptions.arm import (
        arm_yaml as arm_yaml,
        parse_arm as parse_arm,
    )
    from calib_model.descriptions.correction import (
        correction_yaml as correction_yaml,
        parse_correction as parse_correction,
    )
    from calib_model.descriptions.gauge import (
        gauge_yaml as gauge_yaml,
        parse_gauge as parse_gauge,
    )
    from calib_model.descriptions.links import (
        links_of as links_of,
        links_rows as links_rows,
        parse_links as parse_links,
        read_links as read_links,
    )
    from calib_model.descriptions.placements import (
        parse_placements as parse_placements,
        placements_yaml as placements_yaml,
    )
    from calib_model.descriptions.probe import (
        parse_probe as parse_probe,
        probe_yaml as probe_yaml,
    )
    from calib_model.descriptions.standing import (
        SIMULATED as SIMULATED,
        Standing as Standing,
        parse_standing as parse_standing,
        standing_yaml as standing_yaml,
    )
    from calib_model.descriptions.text import (
        read_description as read_description,
        yaml_text as yaml_text,
    )
else:
    __getattr__, __dir__, __all__ = lazily(__name__, __file__)
