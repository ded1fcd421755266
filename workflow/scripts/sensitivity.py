"""How each distance between subspaces answers to noise, and every reading of "a SNR of 10"."""

from hopdata.jobs import reported, write_table
from hopdata.maps.subspaces.distances import noise_sensitivity, snr_readings
from hopdata.maps.subspaces.constraint import read_bases

with reported(snakemake.log[0]):
    _, shape = read_bases(snakemake.input.subspaces)
    seed = snakemake.params.seed
    write_table(snakemake.output.sensitivity, noise_sensitivity(shape, seed=seed))
    write_table(snakemake.output.readings, snr_readings(shape, seed=seed))
