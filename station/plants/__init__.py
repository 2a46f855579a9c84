"""The plants: the equations of a station, behind one interface. Every plant there is is registered here."""

from station.plants.interface import register
from station.plants.thesis import THESIS

for _plant in (THESIS,):
    register(_plant)
