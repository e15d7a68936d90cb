"""What can go wrong with a store."""

from __future__ import annotations

from ..options import OptionError


class StoreError(OptionError):
    """The folder of the option ``store`` cannot be used; the message is one sentence that names the file and the remedy."""


def refused(path: object, error: OSError) -> StoreError:
    """The sentence for a disk that does not take what is written to ``path``."""
    why = error.strerror or error
    return StoreError(f"{path}: the store cannot be written ({why}); make room there and run again, what is done is kept")
