"""6-DoF pose of rotationally symmetric parts from raw point clouds, without a CAD model."""
