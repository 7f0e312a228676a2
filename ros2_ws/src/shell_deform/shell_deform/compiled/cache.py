# SPDX-License-Identifier: Apache-2.0
"""Whether kernels can be compiled, what their sources are, and where they are kept.

Modules of kernels import `kernel_types` and so need numba; whoever uses them asks `HAVE_NUMBA`
first and takes the plain numpy twin otherwise. A read-only installation keeps its cache where
NUMBA_CACHE_DIR, or numba's own per-user fallback, says; without any such place it works uncached.

A cached kernel contains the kernels it calls, but numba looks at its own file only. So the name
under which a kernel is cached carries a digest of all kernel sources: a change in any of them
compiles all anew, and nothing stale is ever run. Another version of numba would overwrite what
this one keeps under the same name: the digest counts it in, too.
"""

from __future__ import annotations

import hashlib
import importlib.util
import os
import warnings
from importlib.metadata import version
from pathlib import Path

# NUMBA_DISABLE_JIT=1 asks for code that can be stepped through, covered and changed at no cost:
# the plain twins.
DISABLED = os.environ.get('NUMBA_DISABLE_JIT', '0') not in ('', '0')
HAVE_NUMBA = importlib.util.find_spec('numba') is not None and not DISABLED

if not HAVE_NUMBA and not DISABLED:  # pragma: no cover - every locked environment has numba
    warnings.warn(
        'numba is not installed: shell_deform works with plain numpy and promises no latency; '
        'install numba for live use',
        RuntimeWarning,
        stacklevel=2,
    )


KERNEL_SOURCES = (
    '**/*kernel*.py',
    'factor/blas.py',
    'factor/elimination.py',
    'factor/forest.py',
    'factor/front_assembly.py',
    'factor/front_types.py',
    'factor/fronts.py',
    'factor/nested_dissection.py',
    'factor/substitution.py',
    'factor/symbolic.py',
    'live/tick/fusion_types.py',
    'surface/closest_point_types.py',
)


def kernel_sources() -> list[Path]:
    """The files of the package whose change changes a kernel."""
    package = Path(__file__).parents[1]
    return sorted({source for pattern in KERNEL_SOURCES for source in package.glob(pattern)})


def _revision() -> str:
    """Digest of all kernel sources of the package and of the version that compiles them."""
    digest = hashlib.sha256(version('numba').encode() if HAVE_NUMBA else b'')
    for source in kernel_sources():
        digest.update(source.read_bytes())
    return digest.hexdigest()[:12]


REVISION = _revision()


def cache_folder() -> Path | None:
    """Where numba keeps the kernels of this package; None where it cannot keep any."""
    import numba

    try:
        return Path(str(numba.njit(cache=True)(cache_folder).stats.cache_path))
    except RuntimeError as error:
        if 'no locator available' not in str(error):
            raise
        return None
