"""Topics of ROS 2 for `tensormass.crtk`: types, and two ways to publish and subscribe: rclpy, or the package cyclonedds without an installation of ROS.

A topic NAME of ROS 2 is the topic rt/NAME of DDS, and a type PACKAGE/msg/NAME is PACKAGE::msg::dds_::NAME_ (design.ros2.org, "Topic and Service name mapping")."""
from __future__ import annotations

import importlib
import os
import types
from typing import Any, Callable, Dict, List, Protocol, Tuple

Fields = Tuple[Tuple[str, str], ...]
_HEADER = ("header", "std_msgs/msg/Header")
#: fields of the types in use; "[]" ends the type of a sequence. crtk_msgs: github.com/collaborative-robotics/crtk_msgs
TYPES: Dict[str, Fields] = {
    "builtin_interfaces/msg/Time": (("sec", "int32"), ("nanosec", "uint32")),
    "std_msgs/msg/Header": (("stamp", "builtin_interfaces/msg/Time"), ("frame_id", "string")),
    "geometry_msgs/msg/Vector3": (("x", "float64"), ("y", "float64"), ("z", "float64")),
    "geometry_msgs/msg/Point": (("x", "float64"), ("y", "float64"), ("z", "float64")),
    "geometry_msgs/msg/Quaternion": (("x", "float64"), ("y", "float64"), ("z", "float64"), ("w", "float64")),
    "geometry_msgs/msg/Pose": (("position", "geometry_msgs/msg/Point"), ("orientation", "geometry_msgs/msg/Quaternion")),
    "geometry_msgs/msg/Twist": (("linear", "geometry_msgs/msg/Vector3"), ("angular", "geometry_msgs/msg/Vector3")),
    "geometry_msgs/msg/Wrench": (("force", "geometry_msgs/msg/Vector3"), ("torque", "geometry_msgs/msg/Vector3")),
    "geometry_msgs/msg/PoseStamped": (_HEADER, ("pose", "geometry_msgs/msg/Pose")),
    "geometry_msgs/msg/TwistStamped": (_HEADER, ("twist", "geometry_msgs/msg/Twist")),
    "geometry_msgs/msg/WrenchStamped": (_HEADER, ("wrench", "geometry_msgs/msg/Wrench")),
    "sensor_msgs/msg/JointState": (_HEADER, ("name", "string[]"), ("position", "float64[]"), ("velocity", "float64[]"), ("effort", "float64[]")),
    "sensor_msgs/msg/Joy": (_HEADER, ("axes", "float32[]"), ("buttons", "int32[]")),
    "crtk_msgs/msg/OperatingState": (_HEADER, ("state", "string"), ("is_homed", "bool"), ("is_busy", "bool")),
    "crtk_msgs/msg/StringStamped": (_HEADER, ("string", "string"))}

Taker = Callable[[Any], None]


class Transport(Protocol):
    """Publishes and subscribes. A message is a nested dictionary to publish, and an object with these fields when received."""

    def publish(self, topic: str, kind: str, message: Dict[str, Any]) -> None:
        """Publishes a message; safe in any thread."""

    def subscribe(self, topic: str, kind: str, take: Taker, reliable: bool = False) -> None:
        """Calls `take` with each message, in the thread of `spin`. reliable: none may be lost."""

    def spin(self, seconds: float) -> None:
        """Waits for messages, at most that long, and hands them over."""

    def close(self) -> None:
        """Ends it."""


def _leaves(value: Dict[str, Any], message: Any) -> Any:
    for name, v in value.items():
        if isinstance(v, dict):
            _leaves(v, getattr(message, name))
        else:
            setattr(message, name, v)
    return message


class Ros:
    """A node of ROS 2, by rclpy."""

    def __init__(self, name: str = "tensormass_crtk") -> None:
        self._rclpy = importlib.import_module("rclpy")
        self._type: Dict[str, Any] = {}
        self._publisher: Dict[str, Any] = {}
        self._kind("crtk_msgs/msg/OperatingState")  # names the missing package before the node starts
        self._rclpy.init()
        self._node = self._rclpy.create_node(name)

    def _kind(self, kind: str) -> Any:
        if kind not in self._type:
            package, _, name = kind.partition("/msg/")
            self._type[kind] = getattr(importlib.import_module(package + ".msg"), name)
        return self._type[kind]

    def publish(self, topic: str, kind: str, message: Dict[str, Any]) -> None:
        """Publishes a message."""
        if topic not in self._publisher:
            self._publisher[topic] = self._node.create_publisher(self._kind(kind), topic, 10)
        self._publisher[topic].publish(_leaves(message, self._kind(kind)()))

    def subscribe(self, topic: str, kind: str, take: Taker, reliable: bool = False) -> None:
        """Calls `take` with each message."""
        qos = importlib.import_module("rclpy.qos")
        self._node.create_subscription(self._kind(kind), topic, take, 10 if reliable else qos.qos_profile_sensor_data)

    def spin(self, seconds: float) -> None:
        """Hands over a message, or waits for one."""
        self._rclpy.spin_once(self._node, timeout_sec=seconds)

    def close(self) -> None:
        """Ends the node."""
        self._node.destroy_node()
        self._rclpy.shutdown()


def _configure(version: str) -> None:
    """Adds a setting to $CYCLONEDDS_URI: peers by Fast DDS, ROS 2's default, are matched by the names of types alone. Their descriptions of types with
    sequences (JointState, Joy) are invalid to Cyclone DDS, which then never matches them (github.com/eclipse-cyclonedds/cyclonedds/pull/2333)."""
    if int(version.split(".")[0]) >= 11:  # earlier ones refuse the setting
        ours = "<Compatibility><IgnoreTypeInformation>1.15</IgnoreTypeInformation></Compatibility>"  # 1.15: the number of Fast DDS' vendor
        os.environ["CYCLONEDDS_URI"] = ",".join(w for w in (ours, os.environ.get("CYCLONEDDS_URI")) if w)


class Dds:
    """Topics of ROS 2 by the package cyclonedds, in the domain $ROS_DOMAIN_ID: nodes of ROS 2 see them, and need no package of types here."""

    def __init__(self) -> None:
        _configure(importlib.import_module("importlib.metadata").version("cyclonedds"))
        self._core, self._idl, self._kinds = (importlib.import_module("cyclonedds." + name) for name in ("core", "idl", "idl.types"))
        self._pub, self._sub, self._topics = (importlib.import_module("cyclonedds." + name) for name in ("pub", "sub", "topic"))
        self._participant = importlib.import_module("cyclonedds.domain").DomainParticipant(int(os.environ.get("ROS_DOMAIN_ID") or 0))
        self._type: Dict[str, Any] = {}
        self._writer: Dict[str, Any] = {}
        self._reader: List[Tuple[Any, Taker, Any]] = []
        self._waits = self._core.WaitSet(self._participant)

    def _field(self, kind: str) -> Any:
        if kind.endswith("[]"):
            return self._kinds.sequence[self._field(kind[:-2])]
        if kind in ("string", "bool"):
            return {"string": str, "bool": bool}[kind]
        return self._kind(kind) if kind in TYPES else getattr(self._kinds, kind)

    def _kind(self, kind: str) -> Any:
        if kind not in self._type:
            package, _, name = kind.partition("/msg/")
            annotations = {field: self._field(of) for field, of in TYPES[kind]}
            made = types.new_class(name + "_", (self._idl.IdlStruct,), {"typename": f"{package}.msg.dds_.{name}_"},
                                   lambda body: body.update({"__annotations__": annotations, "__module__": __name__}))
            self._type[kind] = importlib.import_module("dataclasses").dataclass(made)
        return self._type[kind]

    def _topic(self, topic: str, kind: str) -> Any:
        return self._topics.Topic(self._participant, "rt/" + topic.lstrip("/"), self._kind(kind))

    def _qos(self, reliable: bool, last: int) -> Any:
        qos, ms = importlib.import_module("cyclonedds.qos"), 1000000
        policy = qos.Policy
        return qos.Qos(policy.Reliability.Reliable(100 * ms) if reliable else policy.Reliability.BestEffort, policy.History.KeepLast(last), policy.Durability.Volatile)

    def _made(self, kind: str, value: Any) -> Any:
        return self._kind(kind)(**{name: self._made(of, value[name]) if of in TYPES else value[name] for name, of in TYPES[kind]})

    def publish(self, topic: str, kind: str, message: Dict[str, Any]) -> None:
        """Publishes a message."""
        if topic not in self._writer:
            self._writer[topic] = self._pub.DataWriter(self._participant, self._topic(topic, kind), qos=self._qos(True, 10))
        self._writer[topic].write(self._made(kind, message))

    def subscribe(self, topic: str, kind: str, take: Taker, reliable: bool = False) -> None:
        """Calls `take` with each message."""
        reader = self._sub.DataReader(self._participant, self._topic(topic, kind), qos=self._qos(reliable, 10))
        condition = self._core.ReadCondition(reader, self._core.ViewState.Any | self._core.InstanceState.Any | self._core.SampleState.Any)
        self._waits.attach(condition)
        self._reader.append((reader, take, condition))

    def spin(self, seconds: float) -> None:
        """Waits for messages and hands them over."""
        self._waits.wait(int(seconds * 1e9))
        for reader, take, _ in self._reader:
            for message in reader.take(N=10):
                if message.sample_info.valid_data:
                    take(message)

    def close(self) -> None:
        """Ends it."""
        self._reader.clear()
        self._writer.clear()


def transport() -> Transport:
    """Returns rclpy's node where ROS 2 with crtk_msgs is installed, else cyclonedds'. ImportError: neither is."""
    try:
        return Ros()
    except ImportError as missing:
        try:
            return Dds()
        except ImportError:
            raise missing from None
