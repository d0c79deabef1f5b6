"""Roles of a header are played by bodies, or by joints, as a drawer's goal asks for."""

from safestage_eval.episode import Body, Geom, Header, Joint, check_header


def test_a_joint_may_play_a_role_and_a_stranger_may_not():
    shape = Geom(name="g", kind="sphere", size=(0.1,))
    bodies = (Body(name="drawer", kind="fixture", geoms=(shape,)),)
    joints = (Joint(name="slide", kind="prismatic", body="drawer"),)
    header = Header(
        episode_id="e", physics_dt=0.01, frame_dt=0.01, bodies=bodies, joints=joints,
        roles={"part1": ("slide",), "target": ("drawer",), "surface": ("shelf",)},
    )  # fmt: skip
    [problem] = check_header(header, "x")
    assert "'surface' names 'shelf', which is no body and no joint" in str(problem)
