"""The rehearsal that `make setup` runs."""

from shell_deform import compile_cache
from shell_deform.live import fusion_kernel


def test_it_passes_through_the_kernels_of_the_live_tick():
    compile_cache.compile_kernels()
    for kernel in (fusion_kernel.assemble, fusion_kernel.solve):
        assert kernel.signatures
