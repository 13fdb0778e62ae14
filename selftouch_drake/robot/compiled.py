"""How inner loops are compiled: cached, without the interpreter's lock, and without fast maths.

Numba compiles whole-array expressions for seconds, and a function again for each literal that it
is passed: compiled code is plain loops, and what counts starts as an `np.int64`.
"""

from __future__ import annotations

import numba

# Called from Python.
compiled = numba.njit(cache=True, nogil=True, error_model="numpy", no_cfunc_wrapper=True)
# Called from compiled code alone: compiled in less time.
inner = numba.njit(
    cache=True,
    nogil=True,
    error_model="numpy",
    no_cfunc_wrapper=True,
    no_cpython_wrapper=True,
)
