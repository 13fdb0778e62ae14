"""Compilation of inner loops: cached, without the interpreter's lock, and exact but for one kind.

Numba compiles whole-array expressions for seconds, and a function again for each literal that it
is passed: compiled code is plain loops, and what counts starts as an `np.int64`.
"""

from typing import Any

import numba

# numba's own types do not know the last two.
_OPTIONS: dict[str, Any] = {
    "cache": True,
    "nogil": True,
    "error_model": "numpy",
    "no_cfunc_wrapper": True,
}
# For functions called from Python.
compiled = numba.njit(**_OPTIONS)
# For functions that only compiled code calls: they compile in less time.
inner = numba.njit(**_OPTIONS | {"no_cpython_wrapper": True})
# For inner functions whose sums may be taken in any order, so that they become vectors: the last
# bits depend on the kind of processor.
_ANY_ORDER: Any = {"reassoc", "contract", "nsz", "arcp"}
inner_in_any_order = numba.njit(**_OPTIONS | {"no_cpython_wrapper": True}, fastmath=_ANY_ORDER)
