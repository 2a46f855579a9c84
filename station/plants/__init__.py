"""The plants: the equations of a station, behind one interface. Every plant there is is registered here."""

from station.plants.interface import register
from station.plants.real_gas.registration import REAL_GAS
from station.plants.thesis import THESIS

for _plant in (THESIS, REAL_GAS):
    register(_plant)
