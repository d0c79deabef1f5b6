"""The first verdict does not wait for SciPy's linear algebra, and kernels that want it get it."""

import subprocess
import sys

FIRST = """
import sys
import numba
import numpy as np
from safestage_eval._process import blas

blas.postpone()
blas.postpone()
double = numba.njit(lambda a: a + a)
assert double(np.ones(3)).sum() == 6
assert "numba.np.arraymath" in sys.modules and "scipy.linalg" not in sys.modules
blas.postpone()
product = numba.njit(lambda a, b: np.dot(a, b))
assert product(np.eye(2), np.eye(2)).sum() == 2
assert "scipy.linalg" in sys.modules
"""


def test_it_is_loaded_when_a_kernel_multiplies_matrices():
    subprocess.run([sys.executable, "-c", FIRST], check=True)
