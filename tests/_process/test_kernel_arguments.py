"""An argument is taken for a kernel's type only if numba takes it for that type."""

import numba
import numpy as np
import pytest

from safestage_eval._process.kernel_arguments import fits
from safestage_eval._process.kernel_folder import read_signatures
from safestage_eval._process.kernel_types import from_json
from safestage_eval.geometry.polytope import Pieces

PIECES = "safestage_eval.geometry.polytope:Pieces"


def frozen(array):
    array.flags.writeable = False
    return array


GRID = np.arange(12.0).reshape(3, 4)
VALUES = [
    3, -(2**63), 2**63 - 1, np.int64(3), 3.5, np.float64(3.5), True, np.bool_(0), (1, 2), (1.0,),
    GRID, GRID.T, GRID[:, ::2], GRID[:1], GRID[0], GRID[0, ::2], frozen(GRID.copy()), GRID[:0],
    GRID.astype(np.float32), GRID.astype(int), GRID.astype(np.int32), GRID > 1, np.zeros((2, 2, 2)),
    GRID.view(np.dtype("f8").newbyteorder("=")),  # as Parquet is read: no dtype of numpy's own
    Pieces(GRID[:, :2].copy(), np.arange(3)), Pieces(GRID[:, :2], np.arange(3)),
]  # fmt: skip
KINDS = [
    "int64", "float64", "bool", ["tuple", ["int64", "int64"]], ["tuple", ["float64"]],
    *(["array", item, ndim, layout, mutable] for item in ("float64", "float32", "int64", "bool")
      for ndim in (1, 2, 3) for layout in "CFA" for mutable in (True, False)),
    *(["named", PIECES, [["array", "float64", 2, layout, True], ["array", "int64", 1, "C", True]]]
      for layout in "CA"),
]  # fmt: skip


def test_an_argument_fits_the_type_that_numba_takes_it_for():
    typed = {kind: numba.typeof(value) for kind, value in enumerate(VALUES)}
    fitting = 0
    for kind in KINDS:
        check = fits([kind])
        for number, value in enumerate(VALUES):
            same = typed[number] == from_json(kind)
            assert check((value,)) == same, (kind, value)
            fitting += same
    assert fitting > len(VALUES) // 2


@pytest.mark.parametrize(
    "value",
    [
        2**63,
        np.float32(1),
        "1",
        None,
        [1.0],
        GRID.view(np.recarray),
        GRID.astype(">f8"),
        GRID.astype("f2"),
    ],
)
def test_nothing_else_fits(value):
    assert not any(fits([kind])((value,)) for kind in KINDS)


def test_the_number_of_arguments_counts():
    assert fits(["int64", "bool"])((1, True))
    assert not fits(["int64", "bool"])((1,))
    assert not fits(["int64"])((1, True))


def test_what_only_numba_can_tell_is_an_error():
    with pytest.raises(ValueError, match="only numba can tell"):
        fits([["default", 3]])


def test_every_listed_signature_can_be_checked():
    for kernels in read_signatures().values():
        for all_types in kernels.values():
            for types in all_types:
                assert not fits(types)(())
