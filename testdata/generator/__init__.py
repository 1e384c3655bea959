"""Test photographs of a cylinder or a sphere under planar light, with their truth.

cases     what each set shows: object, material, light, camera, orbit
light     the planar light: sources, a uniform part, a smooth band-limited part
material  the BRDF slice in the measurement plane, in double precision (NumPy only)
quadrature  eq. 4 of [RH01] by integration: the truth, and the check of every rendered set
render    the photographs: Mitsuba's rays, Mitsuba's BSDFs, a sum over directional lights
files     capture.toml, recipe, truth tables, EXR
check     a set read back from disk against the quadrature

[RH01] is R. Ramamoorthi and P. Hanrahan, "Analysis of planar light fields from homogeneous
convex curved surfaces under distant illumination", Proc. SPIE 4299 (2001).
"""
