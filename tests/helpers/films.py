"""A film for tests: three seconds, each in a colour of its own."""

import av
import numpy as np

COLOURS = [(220, 30, 30), (30, 180, 40), (40, 60, 220)]


def film(path):
    """An MP4 of three seconds, each in a colour of its own."""
    with av.open(str(path), "w") as file:
        stream = file.add_stream("libx264", rate=15)
        stream.width, stream.height, stream.pix_fmt = 320, 180, "yuv420p"
        for colour in COLOURS:
            picture = np.full((180, 320, 3), colour, np.uint8)
            for _ in range(15):
                file.mux(stream.encode(av.VideoFrame.from_ndarray(picture, "rgb24")))
        file.mux(stream.encode())
