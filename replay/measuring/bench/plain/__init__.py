"""The particle update in plain Numba, scalar loops without llvmlite, to time the kernels of `estimator` against."""
