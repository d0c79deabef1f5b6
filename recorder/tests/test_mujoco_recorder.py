"""A recording holds the simulator's own numbers: poses, velocities, contacts, forces of every step."""

import numpy as np
import pytest
from zip_arrays import read

mujoco = pytest.importorskip("mujoco")

import safestage_record  # noqa: E402
from safestage_record.told_facts import tell_apart  # noqa: E402

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


def body_names(model):
    return tell_apart([model.body(i).name for i in range(model.nbody)])


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
