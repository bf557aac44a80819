"""Who is who: as a VRM file says, by Mixamo's names, or by the shape."""

import json
import struct

import pytest

import motions
from skeleton import Skeleton
from tests.characters.builder import body, character

BODY = body()
WRITTEN = {
    "hips": "Hips", "spine": "Spine", "chest": "Spine1", "upperChest": "Spine2", "neck": "Neck", "head": "Head",
    **{
        f"{side.lower()}{bone}": f"{side}{name}"
        for side in ("Left", "Right")
        for bone, name in (
            ("Shoulder", "Shoulder"), ("UpperArm", "Arm"), ("LowerArm", "ForeArm"), ("Hand", "Hand"),
            ("UpperLeg", "UpLeg"), ("LowerLeg", "Leg"), ("Foot", "Foot"),
        )
    },
}  # fmt: skip
BONES = {bone: 1 + BODY.names.index(f"mixamorig:{name}") for bone, name in WRITTEN.items()}
VRM = {
    "VRMC_vrm": {"humanoid": {"humanBones": {bone: {"node": node} for bone, node in BONES.items()}}},
    "VRM": {"humanoid": {"humanBones": [{"bone": bone, "node": node} for bone, node in BONES.items()]}},
}
NAMELESS = {name: f"b{number:02d}" for number, name in enumerate(BODY.names)}


def roles_of(path) -> dict[str, str]:
    return dict(Skeleton.from_clip(motions.load(path)).roles)


MIXAMO = {
    role: f"mixamorig:{name}"
    for role, name in [
        ("pelvis", "Hips"), ("chest", "Spine2"), ("neck", "Neck"), ("head", "Head"),
        ("left_shoulder", "LeftShoulder"), ("left_upper_arm", "LeftArm"), ("left_forearm", "LeftForeArm"),
        ("left_hand", "LeftHand"), ("left_thigh", "LeftUpLeg"), ("left_shin", "LeftLeg"), ("left_foot", "LeftFoot"),
        ("right_shoulder", "RightShoulder"), ("right_upper_arm", "RightArm"), ("right_forearm", "RightForeArm"),
        ("right_hand", "RightHand"), ("right_thigh", "RightUpLeg"), ("right_shin", "RightLeg"),
        ("right_foot", "RightFoot"),
    ]
}  # fmt: skip


def test_mixamos_names_tell(tmp_path):
    assert roles_of(character(tmp_path / "hero.glb", BODY)) == MIXAMO


@pytest.mark.parametrize("version", ["VRMC_vrm", "VRM"])
def test_a_vrm_tells_itself(tmp_path, version):
    path = character(tmp_path / "hero.vrm", BODY, names=NAMELESS, extensions={version: VRM[version]})
    clip = motions.load(path)
    assert dict(clip.roles) == {role: NAMELESS[name] for role, name in MIXAMO.items()}
    body = Skeleton.from_clip(clip)
    assert dict(body.roles) == dict(clip.roles)
    assert body.decisions == ()
    # A name that is given by hand wins over the file.
    other = Skeleton.from_clip(clip, roles={"chest": NAMELESS["mixamorig:Spine1"]})
    assert other.roles["chest"] == NAMELESS["mixamorig:Spine1"]


def test_without_names_the_shape_tells(tmp_path):
    body = Skeleton.from_clip(motions.load(character(tmp_path / "hero.glb", BODY, names=NAMELESS)))
    assert "roles guessed from the shape of the body" in body.decisions[0]
    found = {role: body.roles.get(role) for role in ("left_upper_arm", "right_forearm", "left_thigh", "right_shin")}
    assert found == {role: NAMELESS[MIXAMO[role]] for role in found}


def test_a_vrm_that_names_nodes_that_are_not_there_is_none_to_trust(tmp_path):
    path = character(tmp_path / "hero.vrm", BODY)
    data = path.read_bytes()
    length = struct.unpack_from("<I", data, 12)[0]
    top = json.loads(data[20 : 20 + length])
    top["extensions"] = {"VRMC_vrm": {"humanoid": {"humanBones": {"hips": {"node": 999}, "head": {"node": None}}}}}
    text = json.dumps(top).encode()
    text += b" " * (-len(text) % 4)
    rest = data[20 + length :]
    head = struct.pack("<4sII", b"glTF", 2, 20 + len(text) + len(rest)) + struct.pack("<II", len(text), 0x4E4F534A)
    path.write_bytes(head + text + rest)
    assert motions.load(path).roles == {}
