"""What was tried on the networks and did not help; measured once, while they were developed."""

from __future__ import annotations

from models.evaluate.report import Table

CAMERA = Table(
    "Camera: tried, and did not help (measured once, not printed anew)",
    ("tried", "what came of it"),
    (
        (
            "drops as a kind of one frame",
            "0 % right and 55 to 59 points off on `val`, never told as drops, at 25,000 and 42,000 "
            "samples: they are few, and show the scene itself. Even the share of pixels that they "
            "change, read against the clean frame, tells the level to 8.7 points only (44 % "
            "right; of dirt 8.4 points, 44 %), for drops differ in size. Gradient-boosted trees on "
            "the features of one frame tell drops of 30, 60 and 100 % from clean `val` frames with "
            "an area under the curve of 0.66, 0.79 and 0.89; with measures of blocks more (detail "
            "and brightness of each against those beside it) 0.69, 0.82 and 0.92: too little where "
            "clean frames are 150 times as frequent",
        ),
        (
            "what stands still on the lens, by hand: shares of cells darker, smoother or steadier "
            "than those beside them, averaged over seconds, in gradient-boosted trees",
            "drops of 40 % and more told from a clean lens with an area under the curve of 0.96 "
            "to 0.98 in views of `val` frames, but 0.73 to 0.84 in three clips, one of which was "
            "called drops when clean",
        ),
        (
            "the lens's network trained on looks 0.3 to 2 s apart instead of a quarter to half a "
            "second",
            "it cannot know how many looks an average holds: the log likelihood of drops of 100 % "
            "was 3.7 above that of a clean lens in the highway clip, now 6.6",
        ),
        (
            "odds of drops and of dirt of 1 and of 10 % against a clean lens, instead of 3 %",
            "two clean clips by day rated 0.8 and 2.7 % instead of 1.5 %; drops of 100 % told in "
            "29 and 93 % of their frames instead of 74 %, of 60 % in 25 and 93 % instead of 33 %",
        ),
        (
            "the lens's word in what the filter in time takes in",
            "counted anew in every frame: drops of 60 % with a probability of a half, published "
            "as 2 %, and a clean clip never certain enough for a glance",
        ),
        (
            "what was before as inputs of the whole perceptron",
            "hardly used among 1,486 features: at 27,412 samples, every eleventh in a tunnel, a "
            "tunnel of 100 % was 53 to 66 points off 16 to 23 frames after its mouth in three "
            "clips, with a small network of its own on as many 40; and the schedule of kinds on a "
            "city clip was 5.1 points off instead of 2.0 alone, for a step was taken for a mouth",
        ),
        (
            "one change of exposure before a sample, of half of them",
            "what ends is taken for a tunnel's tail: the clean frames after an under-exposure were "
            "51 to 69 points off, with up to four changes, of two thirds, at most 4. With 16 "
            "numbers of what the perceptron holds beside, the clean city clip was rated 10 % "
            "alone, without them 0.1 %",
        ),
        (
            "weather, dirt and motion at the odds of the samples",
            "clean `val` frames rated 0.9 % on average instead of 0.6 % with their odds lowered "
            "twentyfold, main kinds the same (89.5 % right); their kinds told in 85 % instead of "
            "81 % (62,000 samples)",
        ),
        (
            "a perceptron of its own for weather, dirt and motion",
            "that leaves the rest to the first where it is not sure: their kinds told in 39 %, by "
            "one perceptron for all in 55 %; main kinds 85.2 % and 84.3 % right (25,000 samples, "
            "drops among the kinds, as many parameters)",
        ),
        (
            "no look at places: one perceptron on all features",
            "main kinds 86.4 % right, 2.5 points on `val`; with two small layers that look at all "
            "places alike 87.9 % and 2.4; the same layers on features standardised place by "
            "place, without the difference from the whole, 86.5 % and 2.5 (42,000 samples)",
        ),
        (
            "less compression after the degradation (4 % of the samples instead of 12 %)",
            "main kinds 87.8 % right instead of 87.9 %; after JPEG 90 60 % instead of 70 %, after "
            "H.264 of crf 23 46 % instead of 59 % (42,000 samples). More compression without more "
            "clean frames among the compressed once took a clean, soft night drive for a blurred "
            "one",
        ),
        (
            "separate outputs for level and for sixteen kinds",
            "86.1 % right, 2.9 points on 37,000 samples; with kind and level answered jointly, and "
            "without drops, 87.1 % and 2.3 points on as many",
        ),
        (
            "shrinking the frame first",
            "takes noise and blur away before they are seen; every row here is read at native size",
        ),
        (
            "weights of 8 bit",
            "10 µs of the 33 µs that the network takes; the rest of the time is reading the frame",
        ),
    ),
)
"""For the camera's network."""
