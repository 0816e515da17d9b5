#pragma once

#include "render/camera.hpp"
#include "render/image.hpp"
#include "render/stage.hpp"

namespace cleave::render {

/// A picture by ray tracing: a key light from the upper left of the camera with soft shadows, and light from the whole sky that
/// nearby surfaces keep off (ambient occlusion). Each pixel is the mean of `samples` x `samples` rays. The same bits on any
/// number of threads.
Image trace(const Stage&, const Camera&, int width, int height, int samples = 3);

}  // namespace cleave::render
