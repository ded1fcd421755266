"""From markers to planar pose, boom angle and stances: whole recordings, or frame by frame."""
