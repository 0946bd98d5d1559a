"""The ``.cal`` file of a Nano17 whose matrix is easy to reckon with."""


def write_calibration(directory):
    """Write the file of FT7: gauge k alone gives 2 N or N mm a volt along axis k."""
    axes = "".join(
        f'<UserAxis Name="{name}" values="{" ".join("2" if i == k else "0" for k in range(6))}" '
        f'max="{20 if i < 3 else 120}"/>'
        for i, name in enumerate(("Fx", "Fy", "Fz", "Tx", "Ty", "Tz"))
    )
    file = directory / "FT7.cal"
    file.write_text(
        '<FTSensor Serial="FT7" BodyStyle="Nano17" Family="DAQ" NumGages="6" CalFileVersion="1.1">'
        '<Calibration PartNumber="SI-12-0.12" CalDate="1/2/2024" ForceUnits="N" '
        'TorqueUnits="N-mm" DistUnits="mm" OutputRange="20" GainMultiplier="1" '
        f'OutputBipolar="True">{axes}</Calibration></FTSensor>'
    )
    return file
