"""The units that the team reads the sensors in. The simulator itself has none: a value is just a number."""

UNITS = {
    'temperature': '°C',
    'humidity': '%',
    'co2': 'ppm',
    'light': 'lx',
    'soil_moisture': 'm³/m³',
}


def unit_of(sensor: str) -> str:
    """Return the unit of a sensor's values; '' for a sensor that is not one of the five known ones."""
    return UNITS.get(sensor, '')
