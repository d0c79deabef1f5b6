"""A recording holds the simulator's own numbers: poses, velocities, contacts, forces of every step."""

import numpy as np
import pytest
from zip_arrays import read

mujoco = pytest.importorskip("mujoco")

import safestage_record  # noqa: E402
from safestage_record.model_scene import body_names  # noqa: E402

SCENE = """
<mujoco><option timestep="0.002" {option}/><worldbody>
  <geom name="floor" type="plane" size="1 1 1"/>
  <body name="table" pos="0 0 .4"><geom type="box" size=".3 .3 .02"/></body>
  <body name="cube" pos="0 .003 .445"><freejoint/>
    <geom type="box" size=".02 .02 .02" mass=".1" friction="1.5 .02 .001"/></body>
  <body name="wedge" pos=".1 0 .47"><freejoint/><geom type="mesh" mesh="wedge" mass=".05"/></body>
  <body name="ball" pos="-.1 0 .6"><freejoint/><geom size=".02" mass=".02" condim="1"/></body>
  <body name="arm" pos="0 0 .6">
    <joint name="down" type="slide" axis="0 0 1" damping="20" range="-.3 .3" limited="true"/>
    <geom type="box" size=".02 .02 .02" mass="1"/>
    <body name="left_finger" pos="0 .05 -.13">
      <joint name="lf" type="slide" axis="0 1 0" range="-.05 .03" limited="true" damping="5"/>
      <geom type="box" size=".01 .005 .03" mass=".1" condim="4"/></body>
    <body name="right_finger" pos="0 -.05 -.13">
      <joint name="rf" type="slide" axis="0 -1 0" range="-.05 .03" limited="true" damping="5"/>
      <geom type="box" size=".01 .005 .03" mass=".1" condim="6"/></body>
  </body></worldbody>
  <asset><mesh name="wedge" vertex="0 0 0 .04 0 0 0 .04 0 0 0 .04 .01 .01 .01"/></asset>
  <actuator><position joint="down" kp="400"/><position joint="lf" kp="100"/>
    <position joint="rf" kp="100"/></actuator>
</mujoco>
"""


def scene(option=""):
    model = mujoco.MjModel.from_xml_string(SCENE.format(option=option))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def command(data, i):
    data.ctrl[:] = [-0.05, -0.05, -0.05] if i < 20 else [0.1, -0.05, -0.05]


class Witness:
    """MuJoCo's own answers for every step."""

    def __init__(self, model, data):
        self.model, self.data, self.steps = model, data, []
        self.step = mujoco.mj_step

    def __call__(self, m, d, nstep=1):
        for _ in range(nstep):
            time = d.time
            self.step(m, d)
            self.steps.append((time, d.xpos.copy(), d.xquat.copy(), self.speeds(), self.pairs()))

    def speeds(self):
        found = np.zeros((self.model.nbody, 6))
        for i in range(self.model.nbody):
            kind = mujoco.mjtObj.mjOBJ_XBODY
            mujoco.mj_objectVelocity(self.model, self.data, kind, i, found[i], 0)
        return found

    def pairs(self):
        """Pair of bodies → [normal force, force on the second, points]."""
        found, force = {}, np.zeros(6)
        for i in range(self.data.ncon):
            contact = self.data.contact[i]
            if contact.efc_address < 0:
                continue
            mujoco.mj_contactForce(self.model, self.data, i, force)
            if force[0] <= 0 and contact.dist > 0:
                continue
            pair = tuple(int(self.model.geom_bodyid[g]) for g in (contact.geom1, contact.geom2))
            world = self.data.contact.frame[i].reshape(3, 3).T @ force[:3]
            entry = found.setdefault((min(pair), max(pair)), [0.0, np.zeros(3), 0])
            entry[0] += force[0]
            entry[1] = entry[1] + (world if pair[0] < pair[1] else -world)
            entry[2] += 1
        return found


@pytest.mark.parametrize("option", ["", 'cone="elliptic"', 'integrator="implicitfast"'])
@pytest.mark.parametrize("frame_dt", [0.01, None])
def test_every_number_is_the_simulators(tmp_path, monkeypatch, option, frame_dt):
    model, data = scene(option)
    witness = Witness(model, data)
    monkeypatch.setattr(mujoco, "mj_step", witness)
    with safestage_record.mujoco(model, data, tmp_path / "t.zip", frame_dt=frame_dt) as recorder:
        for i in range(40):
            command(data, i)
            mujoco.mj_step(model, data, nstep=20)
            recorder.step(data.ctrl)
    header, arrays = read(tmp_path / "t.zip")
    ids = [body_names(model).index(body["name"]) for body in header["bodies"]]
    moving = [i for i, body in zip(ids, header["bodies"]) if body["movable"]]
    owner = np.repeat(ids, [len(body["geoms"]) for body in header["bodies"]])
    times = np.array([step[0] for step in witness.steps])
    ends = np.concatenate([[0], np.cumsum(arrays["counts"])])
    last, touched = 0, 0
    for k, t in enumerate(arrays["t"]):
        now = int(np.argmin(np.abs(times - t)))
        assert times[now] == pytest.approx(t, abs=1e-9)
        _, xpos, xquat, speeds, pairs = witness.steps[now]
        assert np.allclose(arrays["position"][:, k], xpos[moving], rtol=0, atol=1e-6)
        assert np.allclose(arrays["orientation"][:, k], xquat[moving], rtol=0, atol=1e-6)
        assert np.allclose(arrays["linear_velocity"][:, k], speeds[moving, 3:], atol=1e-5)
        assert np.allclose(arrays["angular_velocity"][:, k], speeds[moving, :3], atol=1e-5)
        if k == 0:
            continue
        recorded = {}
        for row in arrays["contacts"][ends[k] : ends[k + 1]]:
            pair = (int(owner[row["geom1"]]), int(owner[row["geom2"]]))
            sign = 1 if pair[0] < pair[1] else -1
            entry = recorded.setdefault((min(pair), max(pair)), [np.zeros(3), 0.0])
            entry[0] = entry[0] + sign * row["force"]
            entry[1] = float(row["peak_force"])
        between = {}
        for step in witness.steps[last : now + 1]:
            for pair, entry in step[4].items():
                between[pair] = max(between.get(pair, 0.0), entry[0])
        assert set(recorded) == set(between)
        for pair, (force, peak) in recorded.items():
            here = pairs.get(pair, [0.0, np.zeros(3), 0])[1]
            assert np.allclose(force, here, rtol=1e-3, atol=1e-4)
            assert peak == pytest.approx(between[pair], rel=1e-3, abs=1e-4)
        last, touched = now + 1, touched + len(recorded)
    assert touched > 100
    names = body_names(model)
    fingers = [names.index("left_finger"), names.index("right_finger")]
    assert any(
        finger in pair for step in witness.steps for pair in step[4] for finger in fingers
    ), "the scene must have the fingers touch something"


def test_steps_in_two_halves_keep_the_forces_of_the_step(tmp_path):
    """dm_control steps so: contacts are found anew after the step, without forces."""
    model, data = scene()
    twin = mujoco.MjData(model)
    mujoco.mj_forward(model, twin)
    for halves, name in ((True, "a.zip"), (False, "b.zip")):
        mine = data if halves else twin
        with safestage_record.mujoco(model, mine, tmp_path / name, frame_dt=None) as recorder:
            if halves:
                mujoco.mj_step1(model, mine)
            for i in range(30):
                command(mine, i)
                if halves:
                    mujoco.mj_step2(model, mine)
                    mujoco.mj_step(model, mine, nstep=9)
                    mujoco.mj_step1(model, mine)
                else:
                    mujoco.mj_step(model, mine, nstep=10)
                recorder.step()
    first, second = (read(tmp_path / name)[1] for name in ("a.zip", "b.zip"))
    assert len(first["contacts"]) > 50
    for name in ("t", "position", "joint_position", "counts", "contacts"):
        assert np.array_equal(first[name], second[name]), name


def frames_of(arrays):
    """By time: place of each body, and the contacts."""
    ends = np.cumsum(arrays["counts"])
    return {
        round(float(time), 6): (arrays["position"][:, k], arrays["contacts"][end - n : end])
        for k, (time, end, n) in enumerate(zip(arrays["t"], ends, arrays["counts"]))
    }


@pytest.mark.parametrize("order", ["before", "after"])
def test_steps_in_halves_give_the_frames_of_whole_ones_however_many_there_are(tmp_path, order):
    """robosuite finds contacts before every physics step, dm_control after the last."""
    counts = [10] * 5 + [7] + [10, 7] * 3
    found = []
    for halves in (True, False):
        model, data = scene()
        path = tmp_path / f"{halves}.zip"
        with safestage_record.mujoco(model, data, path, frame_dt=None) as recorder:
            if halves and order == "after":
                mujoco.mj_step1(model, data)
            for i, count in enumerate(counts):
                command(data, i)
                for _ in range(count if halves else 0):
                    if order == "before":
                        mujoco.mj_step1(model, data)
                    mujoco.mj_step2(model, data)
                    if order == "after":
                        mujoco.mj_step1(model, data)
                if not halves:
                    mujoco.mj_step(model, data, nstep=count)
                recorder.step()
        found.append(frames_of(read(path)[1]))
    halved, whole = found
    assert len(whole) == 1 + len(counts)
    # that a control step ends sooner than all before is not known in time when contacts are new at its end
    short = sorted(whole)[6]
    assert set(whole) - set(halved) == ({short} if order == "after" else set())
    for time, (place, contacts) in halved.items():
        assert np.array_equal(place, whole[time][0])
        for name in ("position", "normal", "force", "depth", "geom1", "geom2"):
            assert np.array_equal(contacts[name], whole[time][1][name]), (time, name)
    assert sum(len(contacts) for _, contacts in halved.values()) > 50


def test_actions_of_several_kinds_of_numbers_are_one_column(tmp_path):
    model, data = scene()
    given = [np.array([1.5, 2.0]), np.array([3, 4]), [5, 6.25], np.array([7, 8.0], np.float32)]
    for looks in (True, False):
        path = tmp_path / f"{looks}.zip"
        with safestage_record.mujoco(model, data, path, frame_dt=None, substeps=looks) as recorder:
            for action in given:
                mujoco.mj_step(model, data, nstep=5)
                recorder.step(action)
        actions = read(path)[1]["action"]
        assert actions[-4:].tolist() == [list(map(float, action)) for action in given]


def test_without_the_physics_steps_frames_alone_are_recorded_and_the_header_says_so(tmp_path):
    model, data = scene()
    with safestage_record.mujoco(model, data, tmp_path / "t.zip", substeps=False) as recorder:
        for i in range(30):
            command(data, i)
            mujoco.mj_step(model, data, nstep=20)
            recorder.step()
        assert "at frames only" in recorder.report()
    header, arrays = read(tmp_path / "t.zip")
    assert np.allclose(np.diff(arrays["t"])[1:], 0.04)
    assert arrays["t"][1] == pytest.approx(0.038)  # poses are those before the last step
    said = [remark["what"] for remark in header["source"]["account"]]
    assert "contacts and forces between frames" in said
    model, data = scene()
    path = tmp_path / "told.zip"
    with safestage_record.mujoco(model, data, path, substeps=False) as recorder:
        for i in range(30):
            command(data, i)
            for _ in range(20):
                mujoco.mj_step(model, data)
                recorder.substep()
            recorder.step()
    told = read(path)[1]["contacts"]
    assert told["peak_force"].max() >= arrays["contacts"]["peak_force"].max()


def test_frames_alone_are_the_same_looked_at_or_not(tmp_path):
    """Steps that wait as copies are all there, in their order, whenever somebody asks in between."""
    found = []
    for look in (False, True):
        model, data = scene()
        path = tmp_path / f"{look}.zip"
        recorder = safestage_record.mujoco(model, data, path, substeps=False)
        step, poses = recorder.step, []
        for i in range(400):
            command(data, i)
            mujoco.mj_step(model, data, nstep=2)
            poses.append(data.xpos[1:].copy())
            step(np.array([i, 0.5]) if i % 90 else [i, 0.5])
            recorder.success(i == 250)
            if look and i % 7 == 0:
                assert (recorder.stepped, len(recorder)) == (i + 1, i + 2)
        recorder.close()
        with pytest.raises(safestage_record.RecordError, match="closed"):
            step(np.array([0, 0.5]))
        found.append(read(path))
        header, arrays = found[-1]
        assert header["success_time"] == pytest.approx(arrays["t"][251])
        assert np.array_equal(arrays["action"][1:, 0], np.arange(400))
        movable = [i for i, body in enumerate(body_names(model)) if body not in ("world", "table")]
        own = np.array(poses)[:, np.array(movable) - 1].swapaxes(0, 1)
        assert np.array_equal(arrays["position"][:, 1:], own.astype(np.float32))
    for name, values in found[0][1].items():
        assert np.array_equal(values, found[1][1][name]), name


def test_kinds_fingers_masses_shapes_and_joints_are_the_models(tmp_path):
    model, data = scene()
    path = tmp_path / "t.zip"
    tags, up = {"ball": ["fragile"]}, {"wedge": (0, 0, 2)}
    with safestage_record.mujoco(model, data, path, tags=tags, up=up) as recorder:
        mujoco.mj_step(model, data)
        recorder.step()
    header, arrays = read(path)
    bodies = {body["name"]: body for body in header["bodies"]}
    kinds = {name: body["kind"] for name, body in bodies.items()}
    assert kinds["cube"] == kinds["wedge"] == kinds["ball"] == "object"
    assert kinds["table"] == kinds["world"] == "fixture"
    assert (kinds["arm"], kinds["left_finger"]) == ("robot", "gripper")
    for i, name in enumerate(body_names(model)):
        assert bodies[name]["mass"] in (float(model.body_mass[i]), None)
        assert bodies[name]["com"] == model.body_ipos[i].tolist()
        assert bodies[name]["inertia"] == model.body_inertia[i].tolist()
    assert bodies["ball"]["tags"] == ["fragile"]
    assert bodies["wedge"]["up_axis"] == [0.0, 0.0, 1.0]
    assert bodies["cube"]["untold"] == ["up_axis", "cavity"]
    assert bodies["left_finger"]["parent"] == "arm"
    assert "arm" in bodies["left_finger"]["excluded"]
    assert [joint["name"] for joint in header["joints"]] == ["down", "lf", "rf"]
    [geom] = bodies["wedge"]["geoms"]
    vertices = arrays["mesh/" + geom["mesh"] + ".vertices"]
    assert geom["kind"] == "convex_mesh"
    assert len(vertices) == 4  # the hull, without the point inside


def test_fingers_are_named_by_the_user_where_no_name_tells(tmp_path):
    model, data = scene()
    given = {"left_finger": "right", "right_finger": "left"}
    recorder = safestage_record.mujoco(
        model, data, tmp_path / "t.zip", kinds={"arm": "gripper"}, fingers=given
    )
    recorder.stop()
    assert "tilt: no up axes" in recorder.tells()
    assert "held: yes – fingers left_finger right, right_finger left" in recorder.report()


def test_up_axes_are_guessed_only_when_asked(tmp_path):
    for up, expected in ((None, None), ("guess", [0.0, 0.0, 1.0])):
        model, data = scene()
        path = tmp_path / (str(up) + ".zip")
        with safestage_record.mujoco(model, data, path, up=up) as recorder:
            mujoco.mj_step(model, data)
            recorder.step()
        header, _ = read(path)
        bodies = {body["name"]: body for body in header["bodies"]}
        assert bodies["cube"]["up_axis"] == expected
        assert bodies["ball"]["up_axis"] is None
        guessed = [r["what"] for r in header["source"]["account"] if r["kind"] == "guessed"]
        assert any("up axes" in what for what in guessed) == (up == "guess")


def test_success_and_action_are_recorded_at_their_frames(tmp_path):
    model, data = scene()
    with safestage_record.mujoco(model, data, tmp_path / "t.zip", task="pick", seed=3) as recorder:
        for i in range(10):
            mujoco.mj_step(model, data, nstep=10)
            recorder.step([i, 0.5])
            recorder.success(i >= 6)
    header, arrays = read(tmp_path / "t.zip")
    assert header["success"] is True
    assert header["success_time"] == pytest.approx(0.13, abs=0.011)
    assert (header["task"], header["seed"], header["termination"]) == ("pick", 3, "success")
    assert header["control_dt"] == pytest.approx(0.02)
    assert header["frame_dt"] == pytest.approx(0.01)
    assert arrays["action"].shape == (len(arrays["t"]), 2)
    assert (np.diff(arrays["action"][:, 0]) >= 0).all()
    assert arrays["action"][-1, 0] == 9


def test_the_physics_is_the_same_with_and_without_a_recorder(tmp_path):
    ends = []
    for record in (False, True):
        model, data = scene()
        if record:
            recorder = safestage_record.mujoco(model, data, tmp_path / "t.zip")
        for i in range(20):
            command(data, i)
            mujoco.mj_step(model, data, nstep=20)
            if record:
                recorder.step()
        ends.append((data.qpos.copy(), data.qvel.copy(), data.time))
    recorder.close()
    assert all(np.array_equal(a, b) for a, b in zip(*ends))


def test_mujoco_is_as_it_was_when_nothing_is_recorded(tmp_path):
    before = mujoco.mj_step
    model, data = scene()
    recorder = safestage_record.mujoco(model, data, tmp_path / "t.zip")
    with pytest.raises(ZeroDivisionError), recorder:
        assert mujoco.mj_step is not before
        raise ZeroDivisionError
    assert mujoco.mj_step is before
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"roles": {"target": "cub"}}, "Near it: cube"),
        ({"kinds": {"cube": "thing"}}, "Allowed: robot, gripper, object"),
        ({"fingers": {"claw": "left"}}, "is no body of the model"),
        ({"up": {"cube": (0, 0, 0)}}, "three numbers, not all 0"),
    ],
)
def test_wrong_names_say_what_is_allowed(tmp_path, settings, message):
    model, data = scene()
    with pytest.raises(safestage_record.RecordError, match=message):
        safestage_record.mujoco(model, data, tmp_path / "t.zip", **settings)


def test_a_reset_within_a_recording_is_refused(tmp_path):
    model, data = scene()
    recorder = safestage_record.mujoco(model, data, tmp_path / "t.zip")
    mujoco.mj_step(model, data, nstep=10)
    recorder.step()
    mujoco.mj_resetData(model, data)
    with pytest.raises(safestage_record.RecordError, match="before a reset"):
        recorder.step()
    recorder.stop()


def test_an_arm_that_a_mocap_body_leads_is_a_robot(tmp_path):
    """Gymnasium's Fetch is moved so, with its fingers locked."""
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><worldbody>
        <body name="lead" mocap="true" pos="0 0 .5"/>
        <body name="base" pos="0 0 .5"><joint type="slide" axis="1 0 0"/>
          <joint type="slide" axis="0 1 0"/><geom size=".1"/>
          <body name="gripper"><joint type="hinge"/><geom size=".02" pos=".2 0 0"/></body></body>
        <body name="puck" pos="1 0 0"><joint type="slide" axis="1 0 0"/>
          <joint type="slide" axis="0 1 0"/><geom size=".02"/></body>
        </worldbody><equality><weld body1="lead" body2="gripper"/></equality></mujoco>"""
    )
    data = mujoco.MjData(model)
    recorder = safestage_record.mujoco(model, data, tmp_path / "t.zip")
    recorder.stop()
    kinds = {body["name"]: body["kind"] for body in recorder._bodies}
    assert (kinds["base"], kinds["gripper"], kinds["puck"]) == ("robot", "gripper", "object")


def tensor(body):
    """(3, 3) moments of inertia in the body frame."""
    axes = np.zeros(9)
    mujoco.mju_quat2Mat(axes, np.array(body["inertia_orientation"]))
    axes = axes.reshape(3, 3)
    return (axes * np.array(body["inertia"])) @ axes.T


def test_parts_that_no_joint_joins_are_one_thing(tmp_path):
    """Meta-World's models have an object's shapes on a body of their own."""
    shape = '<geom type="box" size=".03 .02 .01" pos=".01 0 .02" euler="0 0 30" mass=".2"/>'
    post = '<geom type="box" size=".01 .01 .05" mass=".1"/>'
    split = f"""<mujoco><worldbody><geom type="plane" size="1 1 1"/><body name="nut" pos="0 0 .1">
        <freejoint/>{shape}<body name="peg" pos=".02 .03 0" euler="0 90 0">{post}</body>
        </body></worldbody></mujoco>"""
    whole = f"""<mujoco><worldbody><geom type="plane" size="1 1 1"/><body name="nut" pos="0 0 .1">
        <freejoint/>{shape}<geom type="box" size=".01 .01 .05" mass=".1" pos=".02 .03 0"
        euler="0 90 0"/></body></worldbody></mujoco>"""
    found = []
    for text in (split, whole):
        model = mujoco.MjModel.from_xml_string(text)
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        path = tmp_path / f"{len(found)}.zip"
        role = {"target": "peg" if text is split else "nut"}
        name = role["target"]
        settings = {"tags": {name: ["fragile"]}, "up": {name: (1, 0, 0)}}
        with safestage_record.mujoco(model, data, path, roles=role, **settings) as recorder:
            for _ in range(30):
                mujoco.mj_step(model, data, nstep=10)
                recorder.step()
        found.append(read(path))
    (first, mine), (second, theirs) = found
    assert [body["name"] for body in first["bodies"]] == ["world", "nut"]
    assert first["roles"] == second["roles"] == {"target": ["nut"]}
    nuts = [said["bodies"][1] for said in (first, second)]
    assert nuts[0]["tags"] == ["fragile"]
    assert np.allclose(nuts[0]["up_axis"], [0, 0, -1])  # the peg's x, as it is turned in the nut
    for key in ("mass", "com"):
        assert np.allclose(nuts[0][key], nuts[1][key], atol=1e-9), key
    assert np.allclose(*(tensor(nut) for nut in nuts), atol=1e-9)
    for a, b in zip(nuts[0]["geoms"], nuts[1]["geoms"]):
        assert np.allclose(a["position"], b["position"], atol=1e-9)
        assert abs(np.dot(a["orientation"], b["orientation"])) == pytest.approx(1)
    assert len(mine["contacts"]) > 20
    early = slice(0, 12)  # until rounding differs in how it lands
    assert np.allclose(mine["position"][:, early], theirs["position"][:, early], atol=1e-6)
    assert {int(g) for g in mine["contacts"]["geom2"]} <= {1, 2}
