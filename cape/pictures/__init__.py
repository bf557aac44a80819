"""Pictures and films of recordings, drawn by the Rerun viewer itself, without a display.

```python
from cape.pictures.viewer import viewer

with viewer((900, 900)) as shown:
    shown.open("walk.rrd")
    shown.choose("cape", side=180.0)  # degrees around the character: 0 from ahead, 90 from its left
    shown.picture(1.5).save("walk.png")  # at 1.5 s
```
"""
