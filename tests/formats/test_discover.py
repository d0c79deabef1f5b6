"""Finding episodes: by content, in order, and past the broken ones."""

import pickle
import shutil

import pytest
from recordings import falling_cube

from safestage_eval.errors import TraceError
from safestage_eval.formats import discover, load, save, validate


@pytest.fixture
def tree(tmp_path):
    """A dataset with an MCAP in it, a folder of MCAPs, and files that are none."""
    falling_cube("d0", policy="pi0", seed=3).close(tmp_path / "runs/dataset")
    falling_cube("d1").close(tmp_path / "runs/dataset")
    falling_cube("m0").close(tmp_path / "runs/dataset/extra.mcap")
    falling_cube("m1", task="lift").close(tmp_path / "runs/loose/b.mcap")
    shutil.copy(tmp_path / "runs/loose/b.mcap", tmp_path / "runs/loose/a.recording")
    (tmp_path / "runs/loose/readme.txt").write_text("notes")
    (tmp_path / "runs/loose/.hidden.mcap").write_text("half a copy")
    return tmp_path / "runs"


def test_every_kind_of_place_is_searched(tree):
    names = [(ref.episode_id, ref.format) for ref in discover(tree)]
    assert names == [
        ("d0", "parquet"),
        ("d1", "parquet"),
        ("m0", "mcap"),
        ("m1", "mcap"),
        ("m1", "mcap"),
    ]
    assert [ref.path.name for ref in discover(tree / "loose")] == ["a.recording", "b.mcap"]


def test_one_episode_is_found_once(tree):
    paths = [tree, tree / "dataset", tree / "loose/b.mcap", tree / "dataset/meta/info.json"]
    assert len(discover(paths)) == 5


def test_a_reference_says_what_its_episode_is(tree):
    ref = discover(tree)[0]
    assert (ref.fields["policy"], ref.fields["seed"], ref.fields["length"]) == ("pi0", 3, 20)
    assert discover(tree / "loose/b.mcap")[0].fields["task"] == "lift"
    again = pickle.loads(pickle.dumps(ref))
    assert again == ref
    episode = again.open()
    assert episode.content_hash == ref.content_hash
    assert episode.path == ref.path
    assert load(episode.path).header == episode.header


def test_both_formats_say_the_same_in_short(tree):
    ref = discover(tree)[0]
    other = save(ref.open(), tree / "copy.mcap")
    assert {**other.fields} == {**ref.fields}


def test_a_broken_episode_does_not_stop_the_others(tree):
    (tree / "loose/b.mcap").write_bytes(b"garbage")
    file = tree / "dataset/meta/episodes/episode-000000.parquet"
    file.write_bytes(file.read_bytes()[:100])
    refs = discover(tree)
    assert [ref.problem is None for ref in refs] == [False, True, True, True, False]
    for ref in refs:
        if ref.problem is None:
            assert len(ref.open()) == 20
        else:
            with pytest.raises(TraceError) as caught:
                ref.open()
            assert caught.value is ref.problem
    assert [error.where for error in validate(tree)] == [str(file), str(tree / "loose/b.mcap")]


def test_a_dataset_that_lost_its_description_is_reported_beside_sound_files(tree):
    """Its episodes cannot be read; that they are there must not be passed over."""
    (tree / "dataset/meta/info.json").unlink()
    problems = [ref.problem for ref in discover(tree) if ref.problem is not None]
    assert [str(problem) for problem in problems] == [
        f"{tree / 'dataset'}: not a whole dataset: meta/info.json is missing. "
        "Fix: copy the dataset again, with all of its folders."
    ]
    assert [ref.episode_id for ref in discover(tree) if ref.problem is None] == ["m0", "m1", "m1"]


@pytest.mark.parametrize("content", [None, "text"])
def test_a_folder_without_episodes_is_an_error(tmp_path, content):
    if content:
        (tmp_path / "a.txt").write_text(content)
    with pytest.raises(TraceError, match="no episode in here"):
        discover(tmp_path)
    assert len(validate(tmp_path)) == 1


def test_an_empty_dataset_is_an_error(tree):
    shutil.rmtree(tree / "dataset/meta/episodes")
    (tree / "dataset/extra.mcap").unlink()
    with pytest.raises(TraceError, match="no episode in here"):
        discover(tree / "dataset")


@pytest.mark.parametrize(
    ("path", "message"),
    [
        ("nowhere", "no such file or folder"),
        ("loose/readme.txt", "neither an MCAP nor a dataset's file"),
        ("dataset/bodies/episode-000000.parquet", "not one of meta/episodes.*meta/info.json"),
        ("loose/rows.jsonl", "results of safestage score go to safestage report tables"),
    ],
)
def test_a_path_that_holds_no_episode_is_an_error(tree, path, message):
    (tree / "loose/rows.jsonl").write_text("{}")
    with pytest.raises(TraceError, match=message):
        discover(tree / path)


def test_no_path_is_an_error():
    with pytest.raises(TraceError, match="no path given"):
        discover([])


def test_load_asks_which_when_there_are_several(tree):
    with pytest.raises(TraceError, match=r"3 episodes are here. Allowed: d0, d1, m0.*episode="):
        load(tree / "dataset/meta/info.json")
    with pytest.raises(TraceError, match="0 episodes are named 'd7'"):
        load(tree / "dataset", "d7")
    assert load(tree / "dataset", "d1").header.episode_id == "d1"


def test_repeated_ids_are_a_problem(tree):
    assert [error.where for error in validate(tree)] == ["m1"]


def test_a_changed_value_is_found_by_the_hash(tree):
    import pyarrow.parquet as pq

    file = tree / "dataset/bodies/episode-000000.parquet"
    table = pq.read_table(file)
    column = table.schema.get_field_index("position.x")
    moved = table.set_column(column, "position.x", table["position.y"])
    pq.write_table(moved, file)
    [error] = validate(tree / "dataset")
    assert "the content of 'd0' has changed since it was written" in error.what


def test_saving_replaces_a_file_and_refuses_what_it_cannot_do(tree):
    episode = load(tree / "dataset", "d0")
    assert save(episode, tree / "loose/b.mcap").episode_id == "d0"
    assert save(episode, tree / "plain", format="mcap").path == tree / "plain"
    assert load(tree / "plain").content_hash == episode.content_hash
    with pytest.raises(TraceError, match="a file stands where the dataset's folder should be"):
        save(episode, tree / "plain", format="parquet")
    with pytest.raises(TraceError, match="there is no format 'csv'"):
        save(episode, tree / "x", format="csv")
    with pytest.raises(TraceError, match="cannot be written"):
        save(episode, tree / "plain/x.mcap")


def test_a_header_number_that_is_not_finite_is_refused_in_both_forms(tree):
    for target in ("ds", "a.mcap"):
        with pytest.raises(TraceError, match="a number that is not finite"):
            falling_cube("e", success_time=float("nan")).close(tree / target)
        assert not (tree / target).exists()
