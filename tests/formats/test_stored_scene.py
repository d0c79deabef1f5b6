"""Bodies that were understood once are taken again only where every byte of them is the same."""

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from safestage_eval.episode import Body, Geom, Header
from safestage_eval.errors import TraceError
from safestage_eval.formats import TraceWriter, discover, save
from safestage_eval.formats.parquet import stored_scene


def recorded(episode_id, *, size=0.1, mass=1.0, name="cube", geoms=2):
    """A body of so many boxes."""
    box = Geom(kind="box", size=(size, 0.1, 0.1))
    writer = TraceWriter(Header(episode_id=episode_id, physics_dt=0.01, frame_dt=0.01))
    writer.add_body(Body(name=name, kind="object", mass=mass, geoms=(box,) * geoms))
    for i in range(3):
        writer.add_frame(0.01 * i, {name: ((0, 0, 0), (1, 0, 0, 0))})
    return writer.episode()


@pytest.fixture
def forgotten():
    """Nothing is known from other tests."""
    stored_scene._SCENES.clear()


SCENES = ({}, {"size": 0.2}, {"mass": 2.0}, {"name": "tin"}, {"geoms": 1})


@pytest.mark.usefixtures("forgotten")
def test_each_episode_has_its_own_bodies_in_whatever_order_they_are_opened(tmp_path):
    truth = {}
    for i, scene in enumerate((*SCENES, *SCENES)):
        truth[f"e{i}"] = recorded(f"e{i}", **scene)
        save(truth[f"e{i}"], tmp_path)
    refs = discover(tmp_path)
    for seed in range(20):
        for ref in (refs[i] for i in np.random.default_rng(seed).permutation(10)):
            assert ref.open().header == truth[ref.episode_id].header
    shared = [ref.open().header.bodies[0] for ref in refs]
    assert shared[0] is shared[5]
    assert len({id(body) for body in shared}) == 5


@pytest.mark.usefixtures("forgotten")
def test_damage_is_noticed_where_the_same_was_read_before(tmp_path):
    save(recorded("e"), tmp_path)
    (ref,) = discover(tmp_path)
    (file,) = (tmp_path / "geometry").glob("*.parquet")
    truth, whole, noticed = ref.open().header, file.read_bytes(), 0
    footer = int.from_bytes(whole[-8:-4], "little") + 8
    for at in range(4, len(whole) - footer, 3):
        file.write_bytes(whole[:at] + bytes([whole[at] ^ 255]) + whole[at + 1 :])
        try:
            assert ref.open().header == truth
        except TraceError:
            noticed += 1
    assert noticed > 100


@pytest.mark.usefixtures("forgotten")
def test_what_was_not_checked_is_checked_later(tmp_path):
    save(recorded("e"), tmp_path)
    (file,) = (tmp_path / "meta" / "episodes").glob("*.parquet")
    rows = pq.read_table(file)
    place = rows.schema.get_field_index("bodies")
    text = rows["bodies"][0].as_py().replace('"mass":1.0', '"mass":-1.0')
    pq.write_table(rows.set_column(place, rows.schema.field(place), pa.array([text])), file)
    (ref,) = discover(tmp_path)
    for _ in range(2):
        assert ref.open(checked=False).header.bodies[0].mass == -1
        with pytest.raises(TraceError, match="mass is -1"):
            ref.open()
