# SPDX-License-Identifier: BSD-3-Clause
"""The exceptions of pymgsfm.

Ctrl-C raises KeyboardInterrupt, too little memory MemoryError, and a file that
the system refuses OSError.
"""

from ._core import InputError, InternalError


class NotSolvableError(RuntimeError):
    """The input is valid, but nothing can be estimated from it."""


__all__ = ["InputError", "InternalError", "NotSolvableError"]
