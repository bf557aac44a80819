"""Measured joint angles of walking and running over one stride, from a foot's contact to its next [degrees].

Rows are evenly spaced over the stride. Positive are: the pelvis tilted forwards, up and forwards on the side of the
foot; hip, knee, shoulder and elbow flexed, hip adducted, ankle dorsiflexed.
"""

import numpy as np

WALK_COLUMNS = ("tilt", "obliquity", "rotation", "hip", "adduction", "knee", "ankle")
RUN_COLUMNS = (*WALK_COLUMNS, "shoulder", "elbow")

# Walking at 0.851 strides/s and 1.388 m a stride, foot off at 65.5 %: means of the normal data in the format of Oxford
# Metrics' clinical software that are distributed with the program gaitutils (gaitutils/data/normal.gcd in
# github.com/NCH-Motion-Laboratory/gaitutils, commit 4eea457), there a row each 2 %. The file doesn't say who
# walked; its standard deviations, mostly below 2 degrees, are those of a person's trials rather than of many people.
WALK_STRIDES_PER_SECOND = 0.851
WALK_STRIDE = 1.388
WALK = np.array(
    [
        (10.9, -0.1, 0.0, 33.5, -1.4, 0.4, 2.0),
        (10.9, 0.5, 0.2, 33.8, 0.6, 3.3, 1.1),
        (10.3, 1.8, 0.7, 32.3, 2.7, 8.1, -1.0),
        (9.0, 3.1, 1.7, 30.3, 3.8, 14.6, 0.6),
        (8.2, 4.2, 2.5, 26.1, 5.2, 15.4, 3.1),
        (8.4, 4.0, 2.3, 22.4, 5.5, 14.9, 5.9),
        (8.4, 3.1, 2.1, 17.9, 5.1, 13.1, 7.7),
        (8.3, 2.1, 1.4, 12.4, 4.5, 9.5, 8.9),
        (8.6, 1.0, 0.6, 7.5, 3.2, 6.5, 10.3),
        (9.0, 0.3, 0.1, 3.2, 2.3, 3.6, 11.8),
        (9.5, -0.2, -0.9, -0.6, 1.4, 1.8, 13.6),
        (10.1, -0.2, -1.1, -3.8, 1.4, 1.2, 15.4),
        (10.7, -0.1, -1.7, -6.5, 1.2, 2.0, 16.5),
        (10.9, -0.2, -2.2, -8.8, 0.6, 4.5, 15.7),
        (10.9, -1.2, -2.5, -9.8, -0.9, 9.8, 12.5),
        (9.9, -2.4, -2.8, -8.0, -2.3, 20.6, 5.0),
        (8.5, -4.1, -3.7, -2.4, -4.4, 36.9, -4.3),
        (8.3, -4.7, -4.4, 5.8, -5.0, 51.8, -10.9),
        (8.7, -3.8, -4.6, 14.8, -4.0, 61.0, -8.5),
        (8.5, -2.8, -4.0, 21.7, -3.1, 64.0, -3.5),
        (8.7, -1.8, -3.2, 27.9, -1.9, 61.0, 0.6),
        (8.9, -0.9, -2.5, 32.4, -0.9, 52.2, 2.3),
        (9.0, -0.5, -1.6, 34.3, -0.4, 38.5, 1.9),
        (9.2, -0.4, -1.1, 34.3, -0.8, 22.8, 1.8),
        (9.7, -0.5, -0.2, 34.1, -1.9, 8.4, 1.8),
    ]
)

# Subject 1 at 3.0 m/s, one stride of the right leg (0.54 s to 1.26 s), of S. R. Hamner and S. L. Delp, "Muscle
# contributions to fore-aft and vertical body mass center accelerations over a range of running speeds", J. Biomechanics
# 46 (2013): inverse kinematics in github.com/stanfordnmbl/addbiomechanics-paper (Hamner2013Running/Processed/subject01/
# osim_results/IK/run300_ik.mot, commit 388c607), OpenSim's signs turned to those above, radians to degrees.
RUN_SPEED = 3.0
RUN_STRIDES_PER_SECOND = 1 / 0.72
RUN = np.array(
    [
        (9.3, 0.2, -7.4, 31.2, 8.6, 22.8, 9.0, -42.4, 110.0),
        (8.9, 0.5, -6.9, 32.5, 10.0, 34.6, 10.9, -37.4, 107.3),
        (8.1, 0.8, -6.2, 31.7, 11.1, 45.1, 18.2, -30.1, 102.4),
        (7.4, 0.6, -5.3, 27.4, 11.2, 49.7, 25.8, -22.1, 98.2),
        (7.1, -0.5, -4.3, 19.9, 9.5, 47.3, 29.3, -16.0, 98.7),
        (7.5, -2.2, -3.1, 11.0, 6.5, 40.1, 26.2, -13.0, 104.4),
        (8.2, -4.0, -1.6, 2.5, 3.3, 31.4, 16.0, -11.9, 112.7),
        (9.0, -5.4, 0.3, -4.4, 0.9, 24.4, 1.6, -11.8, 120.7),
        (9.7, -5.7, 2.1, -8.6, 0.0, 21.6, -11.3, -12.1, 126.5),
        (10.1, -5.0, 3.4, -10.0, 0.8, 24.8, -17.8, -12.9, 129.0),
        (10.0, -3.9, 3.8, -8.8, 2.7, 34.5, -17.4, -14.4, 127.5),
        (9.4, -2.8, 3.9, -5.3, 4.4, 48.7, -13.5, -16.8, 122.9),
        (8.8, -2.3, 4.0, 0.2, 4.2, 64.7, -9.6, -19.4, 115.4),
        (8.6, -2.7, 4.1, 7.3, 1.7, 79.5, -6.0, -21.6, 105.6),
        (8.3, -3.6, 3.6, 15.3, -1.4, 90.9, -2.2, -23.2, 95.3),
        (8.1, -4.3, 2.0, 23.6, -3.1, 97.0, 1.4, -25.4, 88.5),
        (8.1, -4.2, -0.1, 31.3, -3.0, 97.1, 4.5, -29.2, 87.9),
        (8.6, -3.0, -2.3, 37.4, -1.6, 91.3, 6.9, -34.3, 92.1),
        (9.5, -1.3, -4.3, 41.1, 0.3, 80.4, 8.4, -39.7, 97.7),
        (10.2, 0.5, -6.0, 41.8, 2.6, 65.2, 8.9, -44.2, 102.0),
        (10.3, 1.4, -7.2, 39.9, 4.9, 47.4, 9.1, -46.8, 104.8),
        (9.7, 1.3, -7.8, 36.2, 6.3, 30.7, 9.8, -47.6, 106.9),
        (8.6, 0.7, -8.1, 32.7, 6.7, 19.5, 10.6, -46.9, 108.6),
        (7.6, 0.7, -8.1, 30.7, 7.1, 16.6, 10.2, -44.9, 109.9),
    ]
)
