"""Measure the frame changes of the simulated robot without randomness."""

from hopdata.jobs import reported, write_table
from hopdata.steering.robot import camera_of, robot_of
from hopdata.steering.trial import true_frame_changes, true_map_table

with reported(snakemake.log[0]):
    camera = camera_of(snakemake.params.motion_capture)
    robot = robot_of(snakemake.params.robot, camera)
    write_table(snakemake.output.table, true_map_table(true_frame_changes(robot)))
