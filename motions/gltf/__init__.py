"""glTF 2.0: skeletons, animations and skinned meshes of characters, as .glb, .gltf and .vrm files hold them."""
