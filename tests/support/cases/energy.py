"""Models whose light is all accounted for, and models of layers."""

CASES = {
    "ggx kulla-conty narrow": "ggx(alpha=0.001, f0=0.04, energy=kulla_conty)",
    "ggx kulla-conty glass": "ggx(alpha=1, eta=1.5, smith=separable, energy=kulla_conty)",
    "ggx turquin": "ggx(alpha=0.4, eta=0.2, k=[3.9, 2.5, 2.2], energy=turquin)",
    "beckmann kulla-conty": "beckmann(alpha=[0.2, 0.3, 0.5], f0=[0, 0.5, 1], energy=kulla_conty)",
    "beckmann turquin": "beckmann(alpha=0.0001, smith=separable, energy=turquin)",
    "coat lambert": "coat(base=lambert(rho=[0.1, 0.9]), alpha=0.1, eta=1.5)",
    "coat metal": "coat(base=lambert(rho=0.2) + ggx(alpha=0.3, f0=0.9), alpha=0.01, eta=1.33)",
    "coat rough": "coat(base=eon(rho=1, r=1), alpha=1, eta=[1.01, 4])",
    "kelemen plastic": "kelemen(rho=[0.1, 0.5, 1], alpha=0.2, f0=0.04)",
    "kelemen narrow": "kelemen(rho=1, alpha=0.0001, f0=1)",
    "kelemen rough": "kelemen(rho=1, alpha=1, f0=0)",
    "principled": "principled(base_color=[0.8, 0.4, 0.1], roughness=0.4, clearcoat=1, sheen=1)",
    "principled white": "principled(base_color=1, roughness=1, subsurface=0.5, specular=0)",
    "principled metal": "principled(base_color=[0.9, 0.5, 0], roughness=0.2, metallic=1, anisotropic=1)",
    "principled mitsuba": 'principled(base_color=0.5, roughness=0, clearcoat=1, clearcoat_gloss=0, variant="mitsuba")',
}
