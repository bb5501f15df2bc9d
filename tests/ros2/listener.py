"""A subscriber of another process, with types that it declares itself; prints what comes as JSON.

    python listener.py DOMAIN TOPIC NoiseLevel|DiagnosticArray [volatile] [reliable|best_effort]

Runs until its standard input closes. It joins the domain as ROS 2 does with ROS_LOCALHOST_ONLY.
"""

import json
import sys
from dataclasses import asdict, dataclass
from threading import Thread

from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import array, byte, float64, int32, int64, sequence, uint32, uint64
from cyclonedds.qos import Policy, Qos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

LOOPBACK = """<CycloneDDS><Domain><General><Interfaces><NetworkInterface address="127.0.0.1"/>
</Interfaces></General><Discovery><ParticipantIndex>auto</ParticipantIndex>
<MaxAutoParticipantIndex>32</MaxAutoParticipantIndex><Peers><Peer address="localhost"/></Peers>
</Discovery></Domain></CycloneDDS>"""


@dataclass
class Time(IdlStruct, typename="builtin_interfaces.msg.dds_.Time_"):
    sec: int32
    nanosec: uint32


@dataclass
class Header(IdlStruct, typename="std_msgs.msg.dds_.Header_"):
    stamp: Time
    frame_id: str


@dataclass
class NoiseLevel(IdlStruct, typename="murk_msgs.msg.dds_.NoiseLevel_"):
    header: Header
    sequence: uint64
    dropped: uint64
    latency_ns: int64
    level: float64
    std_dev: float64
    probabilities: array[float64, 11]
    raw: float64
    effort: float64
    kind: str
    kinds: sequence[str]
    kind_probabilities: sequence[float64]
    injected_kinds: sequence[str]
    injected_levels: sequence[float64]
    injected_drawn: sequence[str]


@dataclass
class KeyValue(IdlStruct, typename="diagnostic_msgs.msg.dds_.KeyValue_"):
    key: str
    value: str


@dataclass
class DiagnosticStatus(IdlStruct, typename="diagnostic_msgs.msg.dds_.DiagnosticStatus_"):
    level: byte
    name: str
    message: str
    hardware_id: str
    values: sequence[KeyValue]


@dataclass
class DiagnosticArray(IdlStruct, typename="diagnostic_msgs.msg.dds_.DiagnosticArray_"):
    header: Header
    status: sequence[DiagnosticStatus]


def main() -> None:
    domain, name, type_name, *how = sys.argv[1:]
    opened = Domain(int(domain), LOOPBACK)
    participant = DomainParticipant(int(domain))
    reliable = Policy.Reliability.Reliable(max_blocking_time=duration(seconds=1))
    qos = Qos(
        Policy.Reliability.BestEffort if "best_effort" in how else reliable,
        Policy.Durability.Volatile if "volatile" in how else Policy.Durability.TransientLocal,
        Policy.History.KeepLast(1000),
    )
    reader = DataReader(participant, Topic(participant, f"rt{name}", globals()[type_name]), qos)
    sys.stdout.write("ready\n")
    sys.stdout.flush()
    Thread(target=_print_samples, args=(reader,), daemon=True).start()
    sys.stdin.read()
    del reader, participant, opened


def _print_samples(reader: DataReader) -> None:
    for sample in reader.take_iter(timeout=duration(infinite=True)):
        sys.stdout.write(json.dumps(asdict(sample)) + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
