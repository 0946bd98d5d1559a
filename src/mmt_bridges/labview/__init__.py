"""Files of LabVIEW."""
