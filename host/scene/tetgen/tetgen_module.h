/* What the module around the TetGen library offers. TetGen is under the AGPL: the program neither contains nor links it, but
 * opens this module where a scene asks for it and it is installed. */
#ifndef CLEAVE_TETGEN_MODULE_H
#define CLEAVE_TETGEN_MODULE_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Receives the mesh: 3 coordinates per vertex, 4 vertices per tetrahedron, and for each the region it lies in, numbered from 0
 * without gaps; surfaces bound regions. [ownership] module; valid during the call. */
typedef void (*cleave_take_tetrahedra)(void* user, uint64_t vertex_count, const double* vertices, uint64_t tetrahedron_count,
                                       const uint32_t* tetrahedra, const uint32_t* region);

/* Fills closed surfaces of triangles (3 coordinates per vertex, 3 vertices per triangle) with Delaunay tetrahedra of at most
 * the volume given [m^3]. Returns null and calls `take` once, or what was wrong, which stays valid. */
typedef const char* (*cleave_tetrahedralize_function)(uint64_t vertex_count, const double* vertices, uint64_t triangle_count,
                                                      const uint32_t* triangles, double greatest_volume, void* user,
                                                      cleave_take_tetrahedra take);
#define CLEAVE_TETRAHEDRALIZE_SYMBOL "cleave_tetrahedralize"

#ifdef __cplusplus
}
#endif
#endif
