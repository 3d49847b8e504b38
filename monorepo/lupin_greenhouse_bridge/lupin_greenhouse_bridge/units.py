"""The units that the team uses for the sensors. The simulator itself has no units."""

UNITS = {
    'temperature': '°C',
    'humidity': '%',
    'co2': 'ppm',
    'light': 'lx',
    'soil_moisture': 'm³/m³',
}


def unit_of(sensor: str) -> str:
    """Return the unit of a sensor's values; '' for a sensor that is not one of the simulator's five."""
    return UNITS.get(sensor, '')


def label_of(sensor: str) -> str:
    """Return a sensor's name with its unit, such as `co2 (ppm)`."""
    unit = unit_of(sensor)
    return f'{sensor.replace("_", " ")} ({unit})' if unit else sensor.replace('_', ' ')
