"""The card of a trained camera network: what it is, what it saw, what it reaches."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from models.estimate.level import FRAME_KINDS
from models.evaluate.camera import Answers, CleanFrame
from models.training.camera_frames import Recipe

_HEAD = """\
# Camera noise level

Tells from one frame how degraded it is: a distribution over eleven levels (0, 10, …, 100 %) and
the kind ({kinds}).

- Input `features`: what `models.estimate.image_features` reads from a BGR frame of any size, at
  native resolution. Input `history`: what `models.estimate.exposure` keeps of the frames before it,
  zeros where there were none. Outputs `level` and `kind`: logits.
- {parameters:,} parameters; {samples:,} training samples; seed {seed}.
- Reproduce: `murk train camera --data DATA --seed {seed}`; on a machine of another make the last
  digits may differ.

## Trained on

Clean frames, varied (crop, shrinking, gamma, sharpening, sensor noise up to 2.5 counts, JPEG of
quality 75 or more, H.264), then degraded by `models.degrade`: {main:.0%} by blur, over, under or
noise (a quarter by their exact method), {combined:.0%} by two kinds at once, {outer:.0%} by
weather, dirt or motion, the rest by the further kinds; {compressed:.0%} are compressed afterwards.
Six percent are frames of a camera without colour. Four percent of the clean frames are replaced by
black, white or a bare wall, which hold no evidence, half of them with a sensor's noise laid over
the degradation; they are seldom clean. After
the training the odds of a clean frame were raised 150-fold, for in a drive most frames are clean,
and those of weather, dirt and motion lowered twentyfold, for a scene may be hazy or soft by itself.

Then what one frame shows was kept as it was, and a small network learnt from {successive:,} more
samples, four of thirteen in a tunnel's transient up to three time constants after its mouth, what
the frames before tell of it: of each six histories were drawn, which drift as three real clips do,
and it was seen without any every second time. Of the samples that are in no tunnel, a third was
exposed before as it is, the others as the same frame degraded otherwise or as another scene, with
up to four changes. A tunnel's odds were lowered 55-fold in a frame alone, and sevenfold in a run.
{terms}
| source | licence | frames |
|---|---|---|
"""

_RESTRICTED = """
**{count} of these frames are licensed for research or non-commercial use only. Whether weights
trained on them inherit those terms is not settled: for commercial use, train on data of your own.**
"""

_MEASURED = """
## Measured

Clean frames of scenes that are in no other split, at native size; blur, over, under and noise in
equal shares, levels uniform over the eleven; the further kinds, combinations and compression are in
the report of `murk bench estimate`. Nothing was trained on `val` or `test`; the level's temperature
was set on `val`. Mean error: distance of the mean of the distribution from the true level,
percentage points.
"""

_LIMITS = """
## Limits

- Over-exposure of a noisy or sharpened picture is seen by its brightness only, and is the least
  certain; where pixels are locally constant, the gaps in the histogram betray the gain.
- A picture that was resized after it was degraded is not what it was trained on.
- Drops on the lens are not among its kinds: it takes them for a clean scene. Dirt is seen where it
  covers much of the lens; rain and snow that no light falls on, at night, are not seen.
- A tunnel's transient is told by what was before it. In one frame it may be over- or
  under-exposure, and how strong it was at the mouth cannot be seen; see the report of
  `murk bench estimate`.
- Naturally degraded frames (drops on the lens, motion blur) have no true level; none was used.
"""


def write_card(
    path: Path,
    *,
    splits: Mapping[str, list[CleanFrame]],
    answers: Mapping[str, Answers],
    simulated: int,
    samples: int,
    successive: int,
    parameters: int,
    seed: int,
) -> None:
    """Write the card of a network.

    Parameters
    ----------
    path:
        The Markdown file.
    splits:
        Frames by split; ``train`` are those that it learnt from.
    answers:
        What it answered to the other splits, by split.
    simulated:
        Frames of the simulated world that it learnt from as well.
    samples, successive, parameters, seed:
        Of the training.
    """
    restricted = sum(frame.restricted for frame in splits["train"])
    terms = _RESTRICTED.format(count=restricted) if restricted else ""
    recipe = Recipe()
    text = _HEAD.format(
        kinds=", ".join(FRAME_KINDS),
        parameters=parameters,
        samples=samples,
        successive=successive,
        seed=seed,
        main=recipe.main,
        combined=recipe.combined,
        outer=recipe.outer,
        compressed=recipe.compressed,
        terms=terms,
    )
    sources = Counter((frame.source, frame.licence) for frame in splits["train"])
    for (source, licence), count in sorted(sources.items()):
        text += f"| {source} | {licence} | {count} |\n"
    text += f"| murk's simulated world | Apache-2.0 | {simulated} |\n"
    text += _MEASURED
    for split, answer in answers.items():
        text += f"\n**{split}**, all frames\n\n{_table(answer)}"
        certain = np.array([frame.certain for frame in splits[split]])[answer.frames]
        text += f"\n**{split}**, frames that are certainly clean\n\n"
        text += _table(answer.among(certain))
    path.write_text(text + _LIMITS, encoding="utf-8")


def _table(answers: Answers) -> str:
    lines = ["| kind | frames | level right | mean error | kind right |", "|---|---|---|---|---|"]
    lines += [
        f"| {kind} | {row['count']} | {row['accuracy']:.1%} | {row['mean_error']:.1f} "
        f"| {row['kind_accuracy']:.1%} |"
        for kind, row in answers.table().items()
    ]
    return "\n".join(lines) + "\n"
