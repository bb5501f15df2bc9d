"""Fixtures for hardware-in-the-loop tests, in every pytest where murk is installed.

::

    def test_the_ecu_notices_a_noisy_radar_within_500_ms(murk_replay, murk_gateway, ecu):
        murk_replay("drive.log", "can0", loop=True)
        gateway = murk_gateway("can0", "can1")
        assert not ecu.degraded_within(2.0)
        gateway.set("snr", 60)
        assert ecu.degraded_within(0.5)

Nothing heavy is imported before a fixture is used.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from threading import Thread
from typing import TYPE_CHECKING, Protocol

import pytest

if TYPE_CHECKING:
    from node.gateway import Gateway
    from node.player import Player

PLAYER_END_S = 5.0


class OpenGateway(Protocol):
    """What ``murk_gateway`` is."""

    def __call__(
        self,
        source: str,
        target: str,
        scene: Path | None = None,
        *,
        inject: Sequence[str] = (),
        fault: Sequence[str] = (),
        sensor: str | None = None,
        sensor_id: int | None = None,
        seed: int | None = None,
        both_ways: bool = False,
        low_latency: bool = False,
    ) -> Gateway:
        """Start a gateway; arguments as of ``murk gateway``."""


class StartReplay(Protocol):
    """What ``murk_replay`` is."""

    def __call__(
        self,
        log: str | Path,
        bus: str,
        *,
        speed: float = 1.0,
        loop: bool = False,
        ids: Collection[int] | None = None,
    ) -> Player:
        """Start to play a CAN log onto a bus; arguments as of ``murk play``."""


@pytest.fixture
def murk_gateway() -> Iterator[OpenGateway]:
    """Start gateways, which run until the test ends.

    ``murk_gateway(IN, OUT)`` returns a ``node.gateway.Gateway``: ``set(kind, level)`` changes what
    it does from the next message on, ``summary()`` says what it has done.
    """
    with ExitStack() as running:

        def open_gateway(
            source: str,
            target: str,
            scene: Path | None = None,
            *,
            inject: Sequence[str] = (),
            fault: Sequence[str] = (),
            sensor: str | None = None,
            sensor_id: int | None = None,
            seed: int | None = None,
            both_ways: bool = False,
            low_latency: bool = False,
        ) -> Gateway:
            from node.gateway import Gateway, sensor_type_of
            from node.gateway_scene import build_gateway_scene

            wanted = build_gateway_scene(
                scene,
                sensor_type_of(target),
                source,
                name=sensor,
                sensor_id=sensor_id,
                inject=inject,
                fault=fault,
                seed=seed,
            )
            return running.enter_context(
                Gateway(wanted, target, both_ways=both_ways, low_latency=low_latency, control=False)
            )

        yield open_gateway


@pytest.fixture
def murk_replay() -> Iterator[StartReplay]:
    """Play CAN logs onto buses with their original timing, until the test ends.

    ``murk_replay(LOG, BUS)`` returns a ``node.player.Player``.
    """
    with ExitStack() as running:

        def start_replay(
            log: str | Path,
            bus: str,
            *,
            speed: float = 1.0,
            loop: bool = False,
            ids: Collection[int] | None = None,
        ) -> Player:
            from drivers.can_bus import open_bus
            from node.player import Player, Recording

            opened = running.enter_context(open_bus(bus))
            player = Player(Recording([Path(log)], ids), opened, speed=speed, loop=loop)
            running.enter_context(_playing(player))
            return player

        yield start_replay


@contextmanager
def _playing(player: Player) -> Iterator[None]:
    """Run a player in a thread; what it raises is raised at the end."""
    errors: list[Exception] = []

    def run() -> None:
        try:
            player.run()
        except Exception as error:
            errors.append(error)

    thread = Thread(target=run, name="murk-replay", daemon=True)
    thread.start()
    try:
        yield
    finally:
        player.stop()
        thread.join(PLAYER_END_S)
    if errors:
        raise errors[0]
