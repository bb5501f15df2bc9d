"""Jobs on the scans or the frames of MCAP recordings."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from mcap.records import Message

from dbc.errors import InputError
from drivers.frame import Frame
from node.bus.mcap_copy import copy_mcap
from node.bus.mcap_reader import Entry, open_mcap
from node.bus.messages import info_to_ros, to_ros, typestore
from node.bus.recorded_image import image_cdr
from node.dataset.job import Job
from node.dataset.sources import SENSOR_TYPE
from node.recording import decode, info_topic, level_topic, sensor_topics


def degrade(job: Job, path: Path) -> list[dict[str, Any]]:
    """Write the recording with the scans or frames of every fitting topic degraded; a label each.

    All else is copied, but for the noise levels of what is no more. Images become lossless. A
    recording to which nothing happens is copied byte by byte.

    Raises
    ------
    InputError
        If the recording, or a message in it, is damaged.
    """
    change = _Change(job)
    copy_mcap(job.source.path, path, change)
    if not change.labels:
        raise InputError(job.source.path, "holds no message of a sensor", "was it cut off?")
    if not change.changed:
        path.write_bytes(job.source.path.read_bytes())
    return change.labels


class _Change:
    """What becomes of each message; ``labels`` grow with the scans or frames."""

    def __init__(self, job: Job) -> None:
        recording = open_mcap(job.source.path)
        wanted = SENSOR_TYPE[job.source.form]
        topics = [one for one, kind in sensor_topics(recording).items() if kind == wanted]
        self.labels: list[dict[str, Any]] = []
        self.changed = False
        self._job = job
        self._store = typestore()
        self._beside = {topic: info_topic(recording, topic) for topic in topics}
        self._levels = {level_topic(topic) for topic in topics}
        self._infos: dict[str, Message] = {}
        self._counts = dict.fromkeys(topics, 0)

    def __call__(self, topic: str, type_name: str, message: Message) -> Iterator[Message]:
        if topic in self._beside:
            yield from self._degrade(topic, type_name, message)
        elif topic in self._beside.values():
            self._infos[topic] = message  # it is written with what it belongs to
        elif topic not in self._levels:
            yield message

    def _degrade(self, topic: str, type_name: str, message: Message) -> Iterator[Message]:
        info = self._infos.get(self._beside[topic] or "")
        times = message.log_time, message.publish_time, message.sequence
        entry = Entry(topic, type_name, *times, message.data)
        path = self._job.source.path
        original = decode(entry, info.data if info else None, self._counts[topic], path)
        self._counts[topic] += 1
        data = original.image if isinstance(original, Frame) else original
        sensor = f"{self._job.source.sensor}:{topic}"
        degraded, label = self._job.degrade(data, sensor, original.sequence)
        self.labels.append(label)
        if degraded is data:
            yield from (message,) if info is None else (info, message)
            return
        self.changed = True
        if isinstance(original, Frame):
            frame = replace(original, image=degraded)
            cdr = image_cdr(frame, type_name, self._store)
        else:
            cdr = to_ros(degraded, self._store).cdr
            if info is not None:  # the counts in it are of the scan as it is now
                info = replace(info, data=info_to_ros(degraded, self._store).cdr)
        yield from () if info is None else (info,)
        yield replace(message, data=cdr)
