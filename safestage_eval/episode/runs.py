"""Where something holds in a row of frames."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def runs(truth: NDArray[np.bool_]) -> NDArray[np.int64]:
    """(R, 2) half-open frame intervals [first, stop) of consecutive true frames."""
    if not len(truth):
        return np.zeros((0, 2), np.int64)
    changes = (truth[1:] != truth[:-1]).nonzero()[0]
    begun, open_ = int(truth[0]), int(truth[-1])
    out = np.empty(begun + len(changes) + open_, np.int64)
    out[:begun], out[len(out) - open_ :] = 0, len(truth)
    np.add(changes, 1, out=out[begun : begun + len(changes)])
    return out.reshape(-1, 2)
