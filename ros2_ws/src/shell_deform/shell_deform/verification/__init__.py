# SPDX-License-Identifier: Apache-2.0
"""Reference problems: ours beside published, analytic and independent values."""
