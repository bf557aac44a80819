"""What a file may ask for at most: each limit is looked at before anything of that size is made."""

LARGEST_FILE = 2**30
"""Bytes: a million-triangle mesh as text is a tenth of that."""
LARGEST_ARRAYS = 2**30
"""Bytes that the arrays of a file may take together once they are unpacked: an hour of a robot at 60 frames a second
takes 60 MB."""
LARGEST_NUMBER = 1e9
"""Numbers beyond this are taken for damage: no position or angle needs them, and their products would overflow."""
SLOWEST, FASTEST = 5.0, 1000.0
"""Frames per second that a motion has, at least and at most."""
LARGEST_MARKUP = 2**23
"""Bytes of a file of solids (TOML) or of a robot (URDF): those are read at a megabyte a second, into fifty times the
memory."""
LARGEST_MESH = 2**27
"""Bytes of a link's mesh, which is thinned when it has more than some: 2.6 million triangles as STL."""
MOST_COLLIDERS = 100_000
"""In a scene or a file: each takes some microseconds a frame until it is known how deep the cloth is in it."""
MOST_DRAWN = 2_000
"""Colliders that are no capsules in a recording, of each two entities: the viewer's files hold some 10,000."""
MOST_CLOTH_VERTICES = 50_000
"""Vertices of a cloth that comes from a file: one of these takes some hundred times as long as a cape of 1,500."""
MOST_MESH_TRIANGLES = 1_000_000
"""Triangles of a mesh that is read to be remeshed, or to be drawn."""
LARGEST_DESCRIPTION = 2**26
"""Bytes of text that describes a glTF file; its numbers lie beside it, but for a .gltf file that holds all in one."""
LARGEST_TRACK = 2**27
"""Poses of bones in a motion that is brought to another frame rate: of a hundred bones at 60 a second for 6 hours."""
