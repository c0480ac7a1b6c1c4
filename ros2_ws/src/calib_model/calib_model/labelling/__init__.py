# SPDX-License-Identifier: Apache-2.0
"""Which sphere and gauge location a pose belongs to that nobody labelled."""

from typing import TYPE_CHECKING

from calib_model.lazy import lazily

if TYPE_CHECKING:
    from calib_model.labelling.joint_stops import (
        AGAIN as AGAIN,
        held_posture as held_posture,
    )
    from calib_model.labelling.raw_settings import (
        Instruments as Instruments,
        RawSettings as RawSettings,
    )
    from calib_model.labelling.seated_poses import (
        sockets as sockets,
    )
    from calib_model.labelling.sphere_finder import (
        NOWHERE as NOWHERE,
        UNTOUCHED as UNTOUCHED,
        SphereFinder as SphereFinder,
    )
    from calib_model.labelling.sphere_numbering import (
        Numbering as Numbering,
        renumbered as renumbered,
    )
    from calib_model.labelling.unlabelled_bag import (
        Sorted as Sorted,
        label_bag as label_bag,
        label_poses as label_poses,
        numbering_of as numbering_of,
        with_numbers as with_numbers,
    )
else:
    __getattr__, __dir__, __all__ = lazily(__name__, __file__)
