"""The exception tree of murk; it stands on the lowest floor so that every floor can raise it.

::

    MurkError                the run failed                             exit code 1
    └── InputError           what murk was given is wrong               exit code 2
        ├── DatabaseError    a DBC file, or a message that it lacks
        ├── LogError         a CAN log
        ├── VideoError       a video file, an image or an image folder
        ├── DeviceError      a CAN interface or a camera
        ├── SceneError       a scene file or a flag
        ├── ModelError       an ONNX file
        └── MissingExtra     an optional dependency that is not installed
"""

from __future__ import annotations

from collections.abc import Sequence

_MOST_NAMED = 8
"""Places, of many that fared alike."""


class MurkError(Exception):
    """Base of every error that murk raises on purpose; shown as one line, never as a traceback."""

    exit_code = 1


class InputError(MurkError):
    """Something that murk was given is wrong: where, what, and how to put it right.

    Parameters
    ----------
    where:
        The place: a file (with ``:line`` where there is one), a device, a flag, a field.
    what:
        What is wrong there.
    remedy:
        What was expected, or what to do.
    """

    exit_code = 2

    def __init__(self, where: object, what: str, remedy: str = "") -> None:
        self.where = str(where)
        self.what = what
        self.remedy = remedy
        super().__init__(where, what, remedy)

    def __str__(self) -> str:
        text = f"{self.where}: {self.what}" + (f"; {self.remedy}" if self.remedy else "")
        return " ".join(text.split())


def and_others(places: Sequence[str]) -> str:
    """Return what an error's line says of the other places that fared like it; "" of none."""
    if not places:
        return ""
    more = ", …" if len(places) > _MOST_NAMED else ""
    return f" (and {len(places)} more: {', '.join(places[:_MOST_NAMED])}{more})"


class DatabaseError(InputError):
    """A DBC file cannot be read, or lacks a message or signal that is needed."""


class LogError(InputError):
    """A CAN log cannot be read."""


class VideoError(InputError):
    """A video file, an image or an image folder cannot be read."""


class DeviceError(InputError):
    """A CAN interface or a camera is missing, busy or of the wrong kind."""


class SceneError(InputError):
    """A scene file or a command-line flag has an unknown key or an impossible value."""


class ModelError(InputError):
    """An ONNX file is missing, corrupt or not one of murk's."""


class MissingExtra(InputError):  # noqa: N818  (it names what is missing, as ImportError does)
    """A library of an optional extra is not installed.

    Parameters
    ----------
    extra:
        The extra's name: ``ros2``, ``train``, ``view`` or ``scale``.
    feature:
        What was asked for that needs it.
    """

    def __init__(self, extra: str, feature: str) -> None:
        super().__init__(feature, f"needs the extra '{extra}'", f"pip install 'murk[{extra}]'")
