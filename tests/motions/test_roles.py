"""Roles on the naming conventions of motion capture, games, animation programs and robots."""

import pytest

import motions
from motions import ROLES, UnknownNameError, find_roles, require_role
from motions.bodies.roles import require_roles

# For each convention: the trunk from the root to the chest, neck and head, the left arm, the left leg (each a chain);
# then the names expected for the roles of trunk ("-" for none), arm and leg.
TRUNK = ("pelvis", "chest", "neck", "head")
ARM = ("shoulder", "upper_arm", "forearm", "hand")
LEG = ("thigh", "shin", "foot")
CONVENTIONS = {
    "cmu": (
        "Hips LowerBack Spine Spine1", "Neck Neck1 Head",
        "LeftShoulder LeftArm LeftForeArm LeftHand LeftFingerBase", "LHipJoint LeftUpLeg LeftLeg LeftFoot LeftToeBase",
        "Hips Spine1 Neck Head", "LeftShoulder LeftArm LeftForeArm LeftHand", "LeftUpLeg LeftLeg LeftFoot",
    ),
    "cmu asf": (
        "root lowerback upperback thorax", "lowerneck upperneck head",
        "lclavicle lhumerus lradius lwrist lhand lfingers", "lhipjoint lfemur ltibia lfoot ltoes",
        "root thorax lowerneck head", "lclavicle lhumerus lradius lwrist", "lfemur ltibia lfoot",
    ),
    "motion builder hips and knees": (
        "Hips lowerback Chest Chest2", "lowerneck Neck Head",
        "LeftCollar LeftShoulder LeftElbow LeftWrist lhand", "LHipJoint LeftHip LeftKnee LeftAnkle LeftToe",
        "Hips Chest2 lowerneck Head", "LeftCollar LeftShoulder LeftElbow LeftWrist", "LeftHip LeftKnee LeftAnkle",
    ),
    "daz": (
        "hip abdomen chest", "neck head leftEye",
        "lCollar lShldr lForeArm lHand lThumb1", "lButtock lThigh lShin lFoot",
        "hip chest neck head", "lCollar lShldr lForeArm lHand", "lThigh lShin lFoot",
    ),
    "daz genesis": (
        "hip abdomenLower chestUpper", "neckLower neckUpper head",
        "lCollar lShldrBend lShldrTwist lForearmBend lForearmTwist lHand", "lThighBend lThighTwist lShin lFoot lToe",
        "hip chestUpper neckLower head", "lCollar lShldrBend lForearmBend lHand", "lThighBend lShin lFoot",
    ),
    "mixamo": (
        "mixamorig:Hips mixamorig:Spine mixamorig:Spine2", "mixamorig:Neck mixamorig:Head mixamorig:HeadTop_End",
        "mixamorig:LeftShoulder mixamorig:LeftArm mixamorig:LeftForeArm mixamorig:LeftHand mixamorig:LeftHandIndex1",
        "mixamorig:LeftUpLeg mixamorig:LeftLeg mixamorig:LeftFoot mixamorig:LeftToeBase",
        "mixamorig:Hips mixamorig:Spine2 mixamorig:Neck mixamorig:Head",
        "mixamorig:LeftShoulder mixamorig:LeftArm mixamorig:LeftForeArm mixamorig:LeftHand",
        "mixamorig:LeftUpLeg mixamorig:LeftLeg mixamorig:LeftFoot",
    ),
    "underscore prefix": (
        "Character1_Hips Character1_Spine Character1_Spine1", "Character1_Neck Character1_Head",
        "Character1_LeftShoulder Character1_LeftArm Character1_LeftForeArm Character1_LeftHand",
        "Character1_LeftUpLeg Character1_LeftLeg Character1_LeftFoot",
        "Character1_Hips Character1_Spine1 Character1_Neck Character1_Head",
        "Character1_LeftShoulder Character1_LeftArm Character1_LeftForeArm Character1_LeftHand",
        "Character1_LeftUpLeg Character1_LeftLeg Character1_LeftFoot",
    ),
    "rigify": (
        "spine spine.001 spine.002 spine.003", "spine.004 spine.005 spine.006",
        "shoulder.L upper_arm.L forearm.L hand.L f_index.01.L", "thigh.L shin.L foot.L toe.L",
        "spine spine.003 spine.004 spine.006", "shoulder.L upper_arm.L forearm.L hand.L", "thigh.L shin.L foot.L",
    ),
    "auto-rig": (
        "root.x spine_01.x spine_02.x", "neck.x head.x",
        "shoulder.l arm_stretch.l forearm_stretch.l hand.l index1.l", "thigh_stretch.l leg_stretch.l foot.l toes_01.l",
        "root.x spine_02.x neck.x head.x", "shoulder.l arm_stretch.l forearm_stretch.l hand.l",
        "thigh_stretch.l leg_stretch.l foot.l",
    ),
    "blender": (
        "Hips Spine Chest", "Neck Head",
        "Shoulder_L UpperArm_L LowerArm_L Hand_L", "UpperLeg_L LowerLeg_L Foot_L Toes_L",
        "Hips Chest Neck Head", "Shoulder_L UpperArm_L LowerArm_L Hand_L", "UpperLeg_L LowerLeg_L Foot_L",
    ),
    "bandai-namco": (
        "joint_Root Hips Spine Chest", "Neck Head",
        "Shoulder_L UpperArm_L LowerArm_L Hand_L", "UpperLeg_L LowerLeg_L Foot_L Toes_L",
        "Hips Chest Neck Head", "Shoulder_L UpperArm_L LowerArm_L Hand_L", "UpperLeg_L LowerLeg_L Foot_L",
    ),
    "smpl": (
        "Pelvis Spine1 Spine2 Spine3", "Neck Head",
        "L_Collar L_Shoulder L_Elbow L_Wrist L_Hand", "L_Hip L_Knee L_Ankle L_Foot",
        "Pelvis Spine3 Neck Head", "L_Collar L_Shoulder L_Elbow L_Wrist", "L_Hip L_Knee L_Ankle",
    ),
    "lower case": (
        "pelvis spine chest", "neck head",
        "l_shoulder l_elbow l_wrist", "l_hip l_knee l_ankle",
        "pelvis chest neck head", "chest l_shoulder l_elbow l_wrist", "l_hip l_knee l_ankle",
    ),
    "unreal": (
        "root pelvis spine_01 spine_02 spine_03", "neck_01 head",
        "clavicle_l upperarm_l lowerarm_l hand_l index_01_l", "thigh_l calf_l foot_l ball_l",
        "pelvis spine_03 neck_01 head", "clavicle_l upperarm_l lowerarm_l hand_l", "thigh_l calf_l foot_l",
    ),
    "xsens": (
        "Pelvis L5 L3 T12 T8", "Neck Head",
        "LeftShoulder LeftUpperArm LeftForeArm LeftHand", "LeftUpperLeg LeftLowerLeg LeftFoot LeftToe",
        "Pelvis T8 Neck Head", "LeftShoulder LeftUpperArm LeftForeArm LeftHand", "LeftUpperLeg LeftLowerLeg LeftFoot",
    ),
    "rokoko": (
        "Hips Spine1 Spine2 Spine3 Spine4", "Neck Head",
        "LeftShoulder LeftArm LeftForeArm LeftHand", "LeftThigh LeftShin LeftFoot LeftToe",
        "Hips Spine4 Neck Head", "LeftShoulder LeftArm LeftForeArm LeftHand", "LeftThigh LeftShin LeftFoot",
    ),
    "biped": (
        "Bip01 Bip01_Pelvis Bip01_Spine Bip01_Spine1", "Bip01_Neck Bip01_Head",
        "Bip01_L_Clavicle Bip01_L_UpperArm Bip01_L_Forearm Bip01_L_Hand", "Bip01_L_Thigh Bip01_L_Calf Bip01_L_Foot",
        "Bip01_Pelvis Bip01_Spine1 Bip01_Neck Bip01_Head",
        "Bip01_L_Clavicle Bip01_L_UpperArm Bip01_L_Forearm Bip01_L_Hand", "Bip01_L_Thigh Bip01_L_Calf Bip01_L_Foot",
    ),
    "robot": (
        "root_joint waist_yaw_joint waist_roll_joint waist_pitch_joint", "head_joint",
        "left_shoulder_pitch_joint left_shoulder_roll_joint left_shoulder_yaw_joint left_elbow_joint "
        "left_wrist_roll_joint left_wrist_pitch_joint left_wrist_yaw_joint",
        "left_hip_pitch_joint left_hip_roll_joint left_hip_yaw_joint left_knee_joint left_ankle_pitch_joint "
        "left_ankle_roll_joint",
        "root_joint waist_pitch_joint - head_joint",
        "waist_pitch_joint left_shoulder_yaw_joint left_elbow_joint left_wrist_yaw_joint",
        "left_hip_yaw_joint left_knee_joint left_ankle_roll_joint",
    ),
}  # fmt: skip


def build(name: str):
    """Joints, parents and expected roles of a convention."""
    trunk, head, arm, leg, *expected = CONVENTIONS[name]
    joints: list[str] = []
    parents: list[int] = []

    def hang(chain: list[str], parent: int) -> None:
        for joint in chain:
            joints.append(joint)
            parents.append(parent)
            parent = len(joints) - 1

    hang(trunk.split(), -1)
    chest = len(joints) - 1
    pelvis = joints.index(expected[0].split()[0])
    for chain, parent in ((head, chest), (arm, chest), (leg, pelvis)):
        hang(chain.split(), parent)
        if chain is not head:
            hang([mirror(joint, name) for joint in chain.split()], parent)
    roles = {role: joint for role, joint in zip(TRUNK, expected[0].split(), strict=True) if joint != "-"}
    for segments, names in ((ARM, expected[1].split()), (LEG, expected[2].split())):
        for segment, joint in zip(segments, names, strict=True):
            roles[f"left_{segment}"] = joint
            roles[f"right_{segment}"] = joint if joint in trunk.split() else mirror(joint, name)
    return joints, parents, roles


def mirror(joint: str, convention: str) -> str:
    marks = {
        "cmu": ("Left", "L"), "mixamo": ("Left",), "underscore prefix": ("Left",), "xsens": ("Left",),
        "rokoko": ("Left",), "motion builder hips and knees": ("Left", "LHip", "lhand"), "smpl": ("L_",),
        "biped": ("_L_",), "rigify": (".L",), "blender": ("_L",), "bandai-namco": ("_L",), "robot": ("left",),
    }  # fmt: skip
    swap = str.maketrans("lL", "rR")
    for mark in marks.get(convention, ()):
        if mark in joint:
            new = mark.replace("Left", "Right").replace("left", "right")
            return joint.replace(mark, new if new != mark else mark.translate(swap), 1)
    if joint.endswith(("_l", ".l")):
        return joint[:-1] + "r"
    return joint[0].translate(swap) + joint[1:]


@pytest.mark.parametrize("convention", CONVENTIONS)
def test_roles_of_convention(convention):
    joints, parents, expected = build(convention)
    assert len(set(joints)) == len(joints)
    found = find_roles(joints, parents)
    assert found == expected
    assert list(found) == [role for role in ROLES if role in found]


@pytest.mark.parametrize(
    "strange",
    [("Arm",), ("Arm", "ForeArm"), ("ForeArm",), ("UpLeg",), ("UpLeg", "Arm"), ("ToeBase", "UpLeg")],
    ids="-".join,
)
@pytest.mark.parametrize("word", ["Pako", "\u0623\u0644\u0641"])
def test_single_names_that_tell_nothing_are_told_by_those_around_them(strange, word):
    """ "Shoulder" and "leg" mean two things each, and mean what is left to them when a neighbour's name is unknown."""
    joints, parents, expected = build("mixamo")

    def renamed(joint: str) -> str:
        for k, limb in enumerate(strange):
            for side in ("Left", "Right"):
                if joint == f"mixamorig:{side}{limb}":
                    return f"mixamorig:{side}{word}{'' if k == 0 else 'mu'}"
        return joint

    found = find_roles([*map(renamed, joints)], parents)
    assert found == {role: renamed(joint) for role, joint in expected.items()}


def test_what_twists_an_arm_is_no_arm_between_shoulder_and_elbow():
    joints = ["pelvis", "chest", "l_shoulder", "l_shouldertwist", "l_elbow", "r_shoulder", "r_roll1", "r_elbow"]
    found = find_roles(joints, [-1, 0, 1, 2, 3, 1, 5, 6])
    assert (found["left_upper_arm"], found["right_upper_arm"]) == ("l_shoulder", "r_shoulder")


def test_a_leg_that_hangs_at_what_bears_both_is_a_thigh_though_its_foot_is_next():
    joints = ["mitte", "left_leg", "left_foot", "right_leg", "right_foot"]
    found = find_roles(joints, [-1, 0, 1, 0, 3])
    assert (found["left_thigh"], found["right_thigh"]) == ("left_leg", "right_leg")


def test_override_wins_and_guides_what_hangs_below():
    joints = ["a", "b", "c", "d", "e", "f"]
    parents = [-1, 0, 1, 2, 1, 4]
    assert find_roles(joints, parents) == {}
    found = find_roles(joints, parents, {"left_upper_arm": "c", "right_upper_arm": "e"})
    assert found["chest"] == found["left_shoulder"] == "b"
    assert (found["left_forearm"], found["right_forearm"]) == ("d", "f")


def test_unknown_override_lists_what_exists():
    with pytest.raises(UnknownNameError, match=r"no role named 'tail'.*left_shoulder"):
        find_roles(["a"], [-1], {"tail": "a"})
    with pytest.raises(UnknownNameError, match=r"no bone named 'b'; available: a"):
        find_roles(["a"], [-1], {"head": "b"})


def test_missing_role_lists_bones_and_says_how_to_name_one():
    assert require_role("head", {"head": "Kopf"}, ["Kopf"]) == "Kopf"
    with pytest.raises(UnknownNameError) as error:
        require_role("left_shoulder", {}, ["Hips", "Kopf"])
    for part in ("left_shoulder", "Hips, Kopf", 'roles={"left_shoulder": "NAME"}'):
        assert part in str(error.value)
    for part in ("left_shoulder", "Hips, Kopf", "--attach left_shoulder=BONE"):
        assert part in error.value.at_command_line
    with pytest.raises(UnknownNameError, match="'left_shoulder', 'chest'; name them by hand"):
        require_roles(["left_shoulder", "head", "chest"], {"head": "Kopf"}, ["Kopf"])
    with pytest.raises(UnknownNameError, match="no role named 'tail'"):
        require_role("tail", {}, ["Hips"])


def test_deep_chain_is_no_trouble():
    assert find_roles([f"j{i}" for i in range(3000)], range(-1, 2999)) == {}


def test_every_role_is_found_on_real_files(mocap):
    for path in sorted(mocap.glob("*.bvh")):
        clip = motions.load(path)
        assert set(find_roles(clip.joints, clip.parents.tolist())) == set(ROLES), path.name


def test_a_joint_whose_name_tells_nothing_is_the_upper_arm_below_a_shoulder():
    """As where an exporter leaves names in another language beside English ones."""
    joints = [
        "Hips",
        "Chest",
        "LeftShoulder",
        "左腕",
        "LeftForeArm",
        "LeftHand",
        "RightShoulder",
        "右腕",
        "RightForeArm",
    ]
    found = find_roles(joints, [-1, 0, 1, 2, 3, 4, 1, 6, 7])
    assert (found["left_shoulder"], found["left_upper_arm"], found["left_forearm"]) == tuple(joints[2:5])
    assert (found["right_shoulder"], found["right_upper_arm"], found["right_forearm"]) == tuple(joints[6:])


@pytest.mark.parametrize(("joints", "parents"), [(["a"], []), (["a", "b"], [-1, 1]), (["a"], [-2]), (["a"], [0])])
def test_joints_need_a_parent_before_them(joints, parents):
    with pytest.raises(motions.ValueRangeError, match="need as many parents"):
        find_roles(joints, parents)
