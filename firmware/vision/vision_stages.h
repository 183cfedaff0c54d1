// Frame -> MarkerCorners -> PlatePoses. The only folder of the firmware that uses OpenCV, and only in
// aruco_compat.cpp and marker_detector.cpp.
#pragma once

#include "firmware/vision/image_check.h"
#include "firmware/vision/marker_stage.h"
#include "firmware/vision/pose_stage.h"
