"""What is summed while two aligned files go by: distances, spectra, energies."""
