"""Characters: joint trees as Pinocchio models, their bones in the world, capsules around their limbs."""
