"""From markers to pose, boom angle and stances: whole recordings, or frame by frame."""
