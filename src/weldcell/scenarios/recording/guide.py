"""The page that says what each view shows."""

GUIDE = """# What the views show

Press play, or drag the time at the bottom. The timeline `t` runs in seconds and shows every motion; `frame` steps from
one camera picture to the next. The first tab shows the whole cell, the others one stage of the run each.

**The cell**: the robot as it really moved (the simulation's truth), its torch and laser-line sensor, the red light
sheet, and the points measured in the last few seconds.

**Points in the robot base**: everything that a stage has measured so far, where the pipeline places it. Profile points
are yellow near the sensor, green and blue farther away; features are blue (left), yellow (root) and orange (right);
touches of the torch tip are gold; true lines are white. Arrows at checked points lead to where they were measured,
magnified: purple before the compensation, green after it.

**Camera picture**: what the sensor's camera saw. Green dots are stripe centres that were found (every twelfth), big
dots the joint's features.

**Profile in the light plane**: the same stripe in millimetres, across and along the light. The grey outline is the
sensor's measuring range.

**Image processing** (`u-seam`): every 25th picture, step by step, from the median filter to the seam's bridge; the pink
dot is the bridge's centroid, the seam point.

**Errors over time**: distances to the exact truth, which the pipelines never see.

**Stages**: what the cell was doing when.

Pictures and profiles are thinned out to keep the file small: every second picture (unless configured otherwise), every
second point of a profile. All measurements were made on the full data. The lens distortion is not drawn.
"""
