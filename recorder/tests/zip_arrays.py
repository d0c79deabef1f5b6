"""Reads a recording by NumPy and the standard library alone."""

import io
import json
import zipfile

import numpy as np


def read(path):
    """The header, and the arrays by name."""
    with zipfile.ZipFile(str(path)) as archive:
        header = json.loads(archive.read("safestage.json"))
        arrays = {
            name[:-4]: np.lib.format.read_array(io.BytesIO(archive.read(name)))
            for name in archive.namelist()
            if name.endswith(".npy")
        }
    return header["header"], arrays
