# SPDX-License-Identifier: Apache-2.0
"""URDF to Denavit-Hartenberg parameters and back."""

from typing import TYPE_CHECKING

from calib_model.lazy import lazily

if TYPE_CHECKING:
    from calib_model.urdf.denavit_hartenberg import (
        arm_of_chain as arm_of_chain,
    )
    from calib_model.urdf.export_arm import (
        arm_urdf as arm_urdf,
        rigid_parts as rigid_parts,
        rpy as rpy,
    )
    from calib_model.urdf.import_arm import (
        arm_from_urdf as arm_from_urdf,
        read_urdf as read_urdf,
    )
    from calib_model.urdf.joint_origins import (
        with_origins as with_origins,
    )
    from calib_model.urdf.serial_chain import (
        ChainJoint as ChainJoint,
        SerialChain as SerialChain,
        of_rpy as of_rpy,
        read_chain as read_chain,
    )
else:
    __getattr__, __dir__, __all__ = lazily(__name__, __file__)
