"""State of a run on disk: what it has finished, and arrays for which there is no memory."""

from .errors import StoreError
from .fingerprint import digest, program
from .folder import Nowhere, Saved, Store
from .residency import Residency, least_reads
from .space import Space, give_back

__all__ = ["Nowhere", "Residency", "Saved", "Space", "Store", "StoreError", "digest", "give_back", "least_reads", "program"]
