"""The units of the sensors, and how values are written. The simulator itself has no units."""

UNITS = {'temperature': '°C', 'humidity': '%', 'co2': 'ppm', 'light': 'lx', 'soil_moisture': 'm³/m³'}
NAMES = {'co2': 'CO₂'}  # as pictures write them
DECIMALS = {'temperature': 1, 'humidity': 1, 'co2': 0, 'light': 0, 'soil_moisture': 3}


def unit_of(sensor: str) -> str:
    """Return the unit of a sensor's values; '' for a sensor that is not one of the simulator's five."""
    return UNITS.get(sensor, '')


def sensor_order(sensor: str) -> tuple[int, str]:
    """Return a sort key for sensors: those of the simulator in the order of UNITS, then others by name."""
    return (list(UNITS).index(sensor) if sensor in UNITS else len(UNITS)), sensor


def decimals_of(sensor: str) -> int:
    """Return how many decimals the values of a sensor are shown with; 2 for one that is not known."""
    return DECIMALS.get(sensor, 2)


def value_text(sensor: str, value: float) -> str:
    """Return a value as it is shown, without its unit."""
    return f'{value:.{decimals_of(sensor)}f}'


def name_of(sensor: str) -> str:
    """Return a sensor's name as pictures show it, such as `soil moisture`."""
    return NAMES.get(sensor, sensor.replace('_', ' '))


def label_of(sensor: str) -> str:
    """Return a sensor's name with its unit, such as `CO₂ (ppm)`."""
    unit = unit_of(sensor)
    return f'{name_of(sensor)} ({unit})' if unit else name_of(sensor)


def clock_time(time_of_day_seconds: float) -> str:
    """Return hours and minutes of a time of day, such as 13:30."""
    minutes = int(time_of_day_seconds) // 60
    return f'{minutes // 60:02}:{minutes % 60:02}'
