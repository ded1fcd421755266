"""Import this before anything that starts threads: it lets every library have one."""

import os

os.environ.update(
    OMP_NUM_THREADS="1",
    OPENBLAS_NUM_THREADS="1",
    MKL_NUM_THREADS="1",
    NUMBA_NUM_THREADS="1",
    JAX_PLATFORMS="cpu",
    JAX_ENABLE_X64="1",
    JAX_CPU_ENABLE_ASYNC_DISPATCH="0",
    XLA_FLAGS="--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1",
)
