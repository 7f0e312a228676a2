# SPDX-License-Identifier: Apache-2.0
"""The error of this package: one sentence that names the bag, the fault and the way out."""

from __future__ import annotations


class BagError(Exception):
    """A bag cannot be read, written, played or used; the text is one sentence for the user."""
