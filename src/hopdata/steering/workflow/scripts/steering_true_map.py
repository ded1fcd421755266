"""Measure the frame changes of the simulated robot without randomness."""

from hopdata.jobs import reported, write_table
from hopdata.steering.robot import robot_and_camera
from hopdata.steering.trial import true_frame_changes, true_map_table

with reported(snakemake.log[0], snakemake.input, snakemake.output):
    robot, _ = robot_and_camera(snakemake.params.robot, snakemake.params.motion_capture)
    write_table(snakemake.output.table, true_map_table(true_frame_changes(robot)))
