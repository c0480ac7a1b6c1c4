# SPDX-License-Identifier: Apache-2.0
"""Bounded reads, atomic writes, safe YAML, locks, open folders, and what packages bring."""

from typing import TYPE_CHECKING

from calib_model.lazy import lazily

if TYPE_CHECKING:
    from calib_model.files.atomic_write import (
        TAKEN as TAKEN,
        encoded as encoded,
        refuse_taken as refuse_taken,
        write_whole as write_whole,
    )
    from calib_model.files.bounded_read import (
        file_content as file_content,
    )
    from calib_model.files.folder_lock import (
        FolderLock as FolderLock,
    )
    from calib_model.files.held_folder import (
        HeldFolder as HeldFolder,
        is_there as is_there,
        open_file as open_file,
    )
    from calib_model.files.installed import (
        shared_file as shared_file,
    )
    from calib_model.files.one_result import (
        OPTIONAL as OPTIONAL,
        RESULT_FILES as RESULT_FILES,
        file_hashes as file_hashes,
        refuse_mixture as refuse_mixture,
    )
    from calib_model.files.open_folders import (
        Folders as Folders,
        NotPermittedError as NotPermittedError,
        confined as confined,
        reach as reach,
        usual_reading as usual_reading,
        usual_writing as usual_writing,
    )
    from calib_model.files.replaced_folder import (
        made_whole as made_whole,
        refuse_unwritable as refuse_unwritable,
        remove_dead_folders as remove_dead_folders,
        replace_set as replace_set,
        working_folder as working_folder,
    )
    from calib_model.files.safe_yaml import (
        LARGEST_TEXT as LARGEST_TEXT,
        load_plain as load_plain,
    )
    from calib_model.files.yaml_fields import (
        Fields as Fields,
        load_mapping as load_mapping,
    )
else:
    __getattr__, __dir__, __all__ = lazily(__name__, __file__)
