"""Clips of one skeleton joined by a motion graph, with smooth transitions.

The result's `decisions` tell where each part begins and how well the two clips fit there. A blend takes 0.3 s, or
as long as it must so that no joint is faster in it than in the clips around it; a clip is left earlier or later
than asked for where no blend is slow enough.
"""

import motions

graph = motions.MotionGraph([motions.load(name) for name in ("idle", "walk", "kick")], blend=0.3)
clip = graph.play("idle 1s, walk 6s, kick, idle 2s")
print(clip.name, f"{clip.duration:.1f} s", *clip.decisions, sep="\n")
best = graph.transitions("walk", "walk")[0]  # frames at which the walk repeats itself
print(f"from frame {best.leave} to frame {best.enter}: {1000 * best.distance:.1f} mm")
