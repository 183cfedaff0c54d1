// Frame -> MarkerCorners -> PlatePoses. The only folder of the firmware that uses OpenCV, and only in two of its .cpp.
#pragma once

#include "firmware/vision/marker_stage.h"
#include "firmware/vision/pose_stage.h"
