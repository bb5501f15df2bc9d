"""Jobs on videos."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2

from dbc.errors import VideoError
from drivers.video import open_video
from drivers.video_writer import VideoWriter
from node.dataset.job import Job


def degrade(job: Job, path: Path) -> list[dict[str, Any]]:
    """Write the degraded video with its original stamps; return a label a frame.

    It is written without loss: what the file says is what was applied, to the bit.

    Raises
    ------
    VideoError
        If the video cannot be read, has frames that are damaged or missing, or its size or its
        clock jumps.
    """
    cv2.setNumThreads(1)
    labels = []
    with (
        open_video(job.source.path, job.source.sensor) as video,
        VideoWriter(path, lossless=True, threads=1) as writer,
    ):
        for frame in video:
            image, label = job.degrade(frame.image, frame.sensor, frame.sequence)
            try:
                writer.write(image, frame.stamp_ns)
            except VideoError as error:
                what = f"frame {frame.sequence} cannot be copied: {error.what}"
                raise VideoError(job.source.path, what, error.remedy) from error
            labels.append(label)
        if video.dropped:
            promised = len(labels) + video.dropped
            what = f"of its {promised} frames {video.dropped} are damaged or missing"
            raise VideoError(job.source.path, what, "copy it again, or encode what is there anew")
    return labels
