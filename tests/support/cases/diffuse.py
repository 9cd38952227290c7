"""Rough, empirical and volumetric diffusers, and the surfaces of remote sensing."""

from gonio.models.diffuse.minnaert import Minnaert
from gonio.models.volume_scatter.rpv import RPV

CASES = {
    "oren_nayar": "oren_nayar(rho=[0.8, 0.5, 0.1], sigma=0.3)",
    "oren_nayar roughest": "oren_nayar(rho=1, sigma=1.5707963)",
    "oren_nayar smooth": "oren_nayar(rho=1, sigma=0)",
    "oren_nayar qualitative": 'oren_nayar(rho=1, sigma=0.3, form="qualitative")',
    "minnaert": lambda: Minnaert(rho=[0.8, 0.5, 0.1], k=0.7),
    "minnaert k = 0": lambda: Minnaert(rho=1, k=0),
    "minnaert darkest limb": lambda: Minnaert(rho=1, k=5),
    "lommel_seeliger": "lommel_seeliger(w=[0.1, 1])",
    "chandrasekhar white": "chandrasekhar(w=1)",
    "chandrasekhar": "chandrasekhar(w=[0.2, 0.9, 0.9999])",
    "burley_diffuse smooth": "burley_diffuse(rho=1, roughness=0)",
    "burley_diffuse rough": "burley_diffuse(rho=[0.8, 0.5, 0.1], roughness=1)",
    "ashikhmin_shirley_diffuse": "ashikhmin_shirley_diffuse(rd=[0.8, 0.5, 0.1], rs=0.05)",
    "ashikhmin_shirley_diffuse black": "ashikhmin_shirley_diffuse(rd=0, rs=1)",
    "hapke": "hapke(w=0.6, b=0.3, c=0.4, b0=0.8, h=0.06)",
    "hapke narrowest surge": 'hapke(w=[0.2, 0.9], b=0, c=0, b0=1, h=0.0001, h_function="2002")',
    "hapke narrowest lobes": "hapke(w=1, b=0.99, c=-1, b0=0, h=10)",
    "hapke exact": 'hapke(w=1, b=0, c=0, b0=0, h=0.1, h_function="exact")',
    "rpv": lambda: RPV(rho0=[0.05, 0.3], k=0.7, theta=-0.1, rho_c=[0.05, 0.3]),
    "rpv steepest": lambda: RPV(rho0=1, k=0, theta=-0.95, rho_c=0),
    "rpv bell": lambda: RPV(rho0=1, k=2, theta=0.95, rho_c=1),
    "rpv flat": lambda: RPV(rho0=0.2, k=1, theta=0, rho_c=1),
    "ross_li": "ross_li(f_iso=[0.05, 0.3], f_vol=[0.03, 0.1], f_geo=[0.01, 0.05])",
    "ross_li volume": "ross_li(f_iso=0, f_vol=2, f_geo=0)",
    "ross_li crowns": "ross_li(f_iso=0, f_vol=0, f_geo=2)",
}
