"""Names, domains and the network: where what murk sends by DDS can be heard."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from socket import if_nameindex, inet_ntoa

import pytest

pytest.importorskip("cyclonedds", reason="needs the extra 'ros2'")

from dbc.errors import InputError
from node.bus.dds import (
    RosParticipant,
    domain_id,
    node_name,
    ros_name,
)
from node.bus.in_process import Bus
from tests.ros2.listening import ListenerProcess, noise_level
from tests.ros2.outputs import open_output

TOPIC = "/murk/front/noise_level"
Listen = Callable[..., ListenerProcess]


def test_namespace_and_domain_of_the_environment(
    bus: Bus, domain: int, listen: Listen, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
    output = open_output(bus, domain, namespace="/fleet/truck7")
    with closing(output):
        bus.publish(TOPIC, noise_level(1))
        assert listen("/fleet/truck7" + TOPIC).next()["sequence"] == 1
    assert domain_id(None) == domain


@pytest.mark.parametrize(
    "text", ["233", "-1", "seven", "1.0", "²", pytest.param("9" * 5000, id="long")]
)
def test_a_domain_that_is_none_is_refused(text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", text)
    with pytest.raises(InputError, match=r"ROS_DOMAIN_ID.*0 to 232"):
        domain_id(None)
    with pytest.raises(InputError, match="0 to 232"):
        domain_id(233)


def test_names_are_joined_as_ros_joins_them() -> None:
    assert ros_name("", "/murk/a") == "/murk/a"
    assert ros_name("/x/", "/murk/a") == "/x/murk/a"
    assert ros_name("x/y", "node/transition_event") == "/x/y/node/transition_event"


def test_a_scene_of_any_name_is_a_node_of_ros() -> None:
    assert node_name("tunnel_2") == "murk_tunnel_2"
    assert node_name("Überholen, bei Nacht!") == "murk__berholen__bei_Nacht_"


def test_a_domain_is_not_opened_to_the_network_behind_anybodys_back(domain: int) -> None:
    inside = RosParticipant(domain, network=False)
    with pytest.raises(InputError, match=f"DDS domain {domain}: cannot be joined"):
        RosParticipant(domain, network=True)
    inside.close()


def test_a_domain_is_left_behind_and_can_be_joined_again(
    bus: Bus, domain: int, listen: Listen
) -> None:
    listener = listen(TOPIC)
    for number in range(3):
        with closing(open_output(bus, domain)):
            bus.publish(TOPIC, noise_level(number))
            listener.until(lambda message, number=number: message["sequence"] == number)
    assert not listener.waiting()


def test_what_is_sent_leaves_by_loopback(domain: int) -> None:
    before = udp_addresses()
    with Bus() as bus, closing(open_output(bus, domain)):
        opened = udp_addresses() - before
    well_known = range(7400 + 250 * domain, 7400 + 250 * domain + 250)
    sending = {address for address, port in opened if port not in well_known}
    assert sending == {"127.0.0.1"}


def test_the_scene_opens_the_network(domain: int, monkeypatch: pytest.MonkeyPatch) -> None:
    if len(if_nameindex()) < 2:
        pytest.skip("this computer has no interface but loopback")
    monkeypatch.delenv("CYCLONEDDS_URI", raising=False)
    before = udp_addresses()
    with Bus() as bus, closing(open_output(bus, domain, network=True)):
        opened = udp_addresses() - before
    assert {address for address, _ in opened} - {"127.0.0.1", "0.0.0.0"}


def udp_addresses() -> set[tuple[str, int]]:
    """Local address and port of every UDP socket of this process."""
    links = {str(one.readlink()) for one in Path("/proc/self/fd").iterdir() if one.is_symlink()}
    rows = [line.split() for line in Path("/proc/self/net/udp").read_text().splitlines()[1:]]
    own = [row[1].split(":") for row in rows if f"socket:[{row[9]}]" in links]
    return {(inet_ntoa(bytes.fromhex(address)[::-1]), int(port, 16)) for address, port in own}
