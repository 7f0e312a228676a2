"""Where compiled kernels are kept, their types, and the first use that compiles them all."""
