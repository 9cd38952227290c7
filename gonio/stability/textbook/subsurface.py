"""Textbook forms of light below the surface, R by the distance, at forty digits."""

from collections.abc import Callable
from typing import NamedTuple

from gonio.stability.textbook.frame import mp, mpf
from gonio.stability.textbook.fresnel import exact


class Medium(NamedTuple):
    """Albedo α' of a reduced scattering, its mean free path, mm, and the index over that outside."""

    albedo: mpf
    mfp: mpf
    eta: mpf


Profile = Callable[[Medium, mpf], mpf]
_MOMENTS: dict[tuple[int, str], mpf] = {}


def _moment(power: int, eta: mpf) -> mpf:
    """(n + 1) ∫ F μⁿ dμ from within."""
    key = power, mp.nstr(eta, 30)
    if key not in _MOMENTS:
        critical = mp.sqrt(1 - 1 / eta**2)
        passed = mp.quad(lambda m: (1 - exact(m, 1 / eta)) * m**power, [critical, (1 + 3 * critical) / 4, 1])
        _MOMENTS[key] = 1 - (power + 1) * passed if eta != 1 else mpf(0)
    return _MOMENTS[key]


def _flux(z: mpf, sigma: mpf, r: mpf) -> mpf:
    d = mp.sqrt(r * r + z * z)
    return z * (1 + sigma * d) * mp.exp(-sigma * d) / d**3


def dipole(m: Medium, r: mpf) -> mpf:
    """α'/(4π) Σ z (1 + σd) e^(−σd)/d³ of the source and its image [Jensen et al. 2001, eq. 4]."""
    sigma, back = mp.sqrt(3 * (1 - m.albedo)) / m.mfp, _moment(1, m.eta)
    image = m.mfp * (1 + mpf(4) / 3 * (1 + back) / (1 - back))
    return m.albedo / (4 * mp.pi) * (_flux(m.mfp, sigma, r) + _flux(image, sigma, r))


def better_dipole(m: Medium, r: mpf) -> mpf:
    """α'²/(4π) of the flux and the fluence of both, with Grosjean's diffusion [d'Eon 2012]."""
    diffusion = (2 - m.albedo) * m.mfp / 3
    c1, c2 = _moment(1, m.eta), _moment(2, m.eta)
    sigma = mp.sqrt((1 - m.albedo) / m.mfp / diffusion)
    image = m.mfp + 4 * diffusion * (1 + c2) / (1 - c1)
    near, far = (mp.sqrt(r * r + z * z) for z in (m.mfp, image))
    fluence = mp.exp(-sigma * near) / near - mp.exp(-sigma * far) / far
    flux = _flux(m.mfp, sigma, r) + _flux(image, sigma, r)
    return m.albedo**2 / (4 * mp.pi) * ((1 - c2) / 2 * flux + (1 - c1) / (4 * diffusion) * fluence)


def normalised_diffusion(m: Medium, r: mpf) -> mpf:
    """A s (e^(−sr) + e^(−sr/3))/(8πr) [Christensen & Burley 2015], A = 1 − √(1 − α') H(1) by H's own integral."""
    key = 0, mp.nstr(m.albedo, 30)
    if key not in _MOMENTS:
        # ln H(1) = −1/π ∫ ln(1 − α' t cot t) dt over 0..π/2 with tan t for the frequency [Chandrasekhar 1960].
        log_h = -mp.quad(lambda t: mp.log(1 - m.albedo * t * mp.cot(t)), [0, mpf("0.01"), mp.pi / 4, mp.pi / 2]) / mp.pi
        _MOMENTS[key] = 1 - mp.sqrt(1 - m.albedo) * mp.exp(log_h) if m.albedo != 1 else mpf(1)
    share = _MOMENTS[key]
    s = (mpf("1.85") - share + 7 * abs(share - mpf("0.8")) ** 3) / m.mfp
    return share * s * (mp.exp(-s * r) + mp.exp(-s * r / 3)) / (8 * mp.pi * r)


PROFILES: dict[str, Profile] = {
    "dipole": dipole,
    "better_dipole": better_dipole,
    "normalised_diffusion": normalised_diffusion,
}
