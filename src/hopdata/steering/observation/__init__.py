"""From markers to pose in the plane, boom angle and stances: whole recordings or frame by frame."""
