"""ROS 2 bags with transforms and a description of a robot, in MCAP and in SQLite."""

import sqlite3

from mcap.reader import make_reader

STAMP = "builtin_interfaces/Time stamp\nstring frame_id"
TF_MESSAGE = f"""geometry_msgs/TransformStamped[] transforms
{"=" * 80}
MSG: geometry_msgs/TransformStamped
std_msgs/Header header
string child_frame_id
geometry_msgs/Transform transform
{"=" * 80}
MSG: std_msgs/Header
{STAMP}
{"=" * 80}
MSG: geometry_msgs/Transform
geometry_msgs/Vector3 translation
geometry_msgs/Quaternion rotation
{"=" * 80}
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
{"=" * 80}
MSG: geometry_msgs/Quaternion
float64 x
float64 y
float64 z
float64 w
{"=" * 80}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
ARM = """<robot name="arm">
  <link name="base"/>
  <link name="upper">
    <inertial><mass value="2.5"/><origin xyz="0 0 0.1"/></inertial>
    <visual><geometry><box size="1 1 1"/></geometry></visual>
    <collision><origin xyz="0 0 0.2" rpy="0 1.5707963267948966 0"/>
      <geometry><cylinder radius="0.05" length="0.4"/></geometry></collision>
  </link>
  <link name="hand"><collision><geometry><mesh filename="package://arm/hand.stl"/></geometry></collision>
    <collision><geometry><sphere radius="0.04"/></geometry></collision></link>
  <joint name="j" type="revolute"><parent link="base"/><child link="upper"/></joint>
  <joint name="f" type="fixed"><parent link="upper"/><child link="hand"/></joint>
</robot>"""


def ros_transform(stamp_ns, parent, child, position, orientation):
    w, x, y, z = map(float, orientation)
    return {
        "header": {
            "stamp": {"sec": stamp_ns // 10**9, "nanosec": stamp_ns % 10**9},
            "frame_id": parent,
        },
        "child_frame_id": child,
        "transform": {
            "translation": dict(zip("xyz", map(float, position), strict=True)),
            "rotation": {"x": x, "y": y, "z": z, "w": w},
        },
    }


def as_sqlite(mcap, to, *, leave_out=()):
    """Write the messages as rosbag2's SQLite storage has them."""
    with sqlite3.connect(to) as bag:
        bag.execute("CREATE TABLE schema(schema_version INTEGER PRIMARY KEY, ros_distro TEXT)")
        bag.execute(
            "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT, "
            "offered_qos_profiles TEXT)"
        )
        bag.execute(
            "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)"
        )
        with mcap.open("rb") as stream:
            known = {}
            for schema, channel, message in make_reader(stream).iter_messages():
                if channel.topic not in known:
                    known[channel.topic] = len(known) + 1
                    if channel.topic not in leave_out:
                        row = (known[channel.topic], channel.topic, schema.name, "cdr", "")
                        bag.execute("INSERT INTO topics VALUES (?, ?, ?, ?, ?)", row)
                row = (known[channel.topic], message.log_time, message.data)
                bag.execute("INSERT INTO messages(topic_id, timestamp, data) VALUES (?, ?, ?)", row)
    bag.close()
    return to
