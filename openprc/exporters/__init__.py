"""Writers of plain formats that the package brings itself."""
