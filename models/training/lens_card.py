"""The card of the lens's network: what it does, what it was trained on, how it was measured."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from models.estimate.lens import LOOK_EVERY_S, TIME_CONSTANT_S
from models.estimate.level import LENS_ODDS
from models.evaluate.camera import CleanFrame
from models.evaluate.report import Table, markdown

_HEAD = """\
# What sticks to the lens

Tells from successive frames of one camera whether drops or dirt are on its lens, and how much: for
each of both and each level from 10 to 100 % how likely that makes what was seen, against a clean
lens.

- Input `lens`: (1, 5, 16, columns), averages of log detail and log brightness in cells of 1/64 of
  the frame's height, over looks every {every:g} s that fade with {constant:g} s, their standard
  deviations in time, and log of the time since the first look; see `models.estimate.lens`.
  Output `log_ratios`: (1, 2, 10), natural logarithms.
- {parameters:,} parameters; {samples:,} training samples; temperature {temperature:.2f}, set on the
  views of `val`; seed {seed}.
- Reproduce: `murk train lens --data DATA --seed {seed}`; on a machine of another make the last
  digits may differ.
- To murk drops, and dirt, are {odds:g} times as frequent on a drive as a clean lens, at all levels
  together. By these odds and the ratios it shares out what a frame, filtered in time, is taken for
  clean.

## Trained on

Views as of a drive through single clean frames, three in ten of them varied as for the camera's
network (outwards from a vanishing point, the faster the farther from it; a quarter of the vehicles
stand, others stop; half of them show a bonnet), a scene of frames taken one after the other, and
simulated drives; 2 to 36 looks, 0.26 to 0.5 s apart. Of each, two with drops, two with dirt, and
four of which three are clean and one is degraded otherwise, all by `models.degrade`; some with a
sensor's noise or JPEG. Four in a hundred show black, white or a wall.
{terms}
| source | licence | frames |
|---|---|---|
"""

_RESTRICTED = """
**{count} of these frames are licensed for research or non-commercial use only. Whether weights
trained on them inherit those terms is not settled: for commercial use, train on data of your own.**
"""

_MEASURED = """| murk's simulated world | Apache-2.0 | simulated |

## Measured

Real frames, degraded, from three seconds after the first one on: three clips, of which nothing was
trained on, and three scenes whose frames were taken half a second or two seconds apart, taken as
half a second apart (one of split `val`, on which the temperature was set). Mean error: distance of
the mean of the distribution from the true level, percentage points; beside it what each frame says
alone (`camera.onnx`), and what is published once the frames' own levels are filtered in time.

{table}

## Limits

- One frame tells nothing: a lens is looked at every {every:g} s, and judged from the second look
  on. Where vehicle and scene stand still, nothing tells what is on the lens from what is before it.
- The level is a rough one: as many drops can be small or large, and much dirt thin or thick.
- In the dark neither shows.
- Where a frame by itself is taken for blurred or noisy, what is on the lens stays unsaid.
- Drops and dirt are those of `models.degrade`: nothing was measured on a lens that was really wet
  or dirty.
"""


def write_card(
    path: Path,
    *,
    frames: Sequence[CleanFrame],
    samples: int,
    parameters: int,
    temperature: float,
    seed: int,
    table: Table,
) -> None:
    """Write the card.

    Parameters
    ----------
    path:
        The Markdown file.
    frames:
        Those that it learnt from.
    samples, parameters, temperature, seed:
        Of the training.
    table:
        What it reaches: ``models.evaluate.lens.lens_table``.
    """
    restricted = sum(frame.restricted for frame in frames)
    text = _HEAD.format(
        every=LOOK_EVERY_S,
        constant=TIME_CONSTANT_S,
        parameters=parameters,
        samples=samples,
        temperature=temperature,
        odds=LENS_ODDS,
        seed=seed,
        terms=_RESTRICTED.format(count=restricted) if restricted else "",
    )
    sources = Counter((frame.source, frame.licence) for frame in frames)
    for (source, licence), count in sorted(sources.items()):
        text += f"| {source} | {licence} | {count} |\n"
    lines = "\n".join(markdown(table.columns, table.rows))
    path.write_text(text + _MEASURED.format(table=lines, every=LOOK_EVERY_S), encoding="utf-8")
