# SPDX-License-Identifier: Apache-2.0
"""What every node of the suite shares: its life, its parameters, messages and QoS."""

from typing import TYPE_CHECKING

from calib_model.lazy import lazily

if TYPE_CHECKING:
    from calib_model.nodes.lifecycle import (
        NodeCommand as NodeCommand,
        init as init,
        lean_executor as lean_executor,
        refuse_other_encodings as refuse_other_encodings,
        run_node as run_node,
    )
    from calib_model.nodes.messages import (
        joints_of as joints_of,
        qos_of as qos_of,
        stamp_of as stamp_of,
        time_of as time_of,
    )
    from calib_model.nodes.parameters import (
        Parameters as Parameters,
        Proposal as Proposal,
        unheard as unheard,
        warn_of_unknown as warn_of_unknown,
    )
else:
    __getattr__, __dir__, __all__ = lazily(__name__, __file__)
