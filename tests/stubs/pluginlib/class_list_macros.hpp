// Checks that a plugin is what it is registered as.
#pragma once
#include <type_traits>

#define PLUGINLIB_EXPORT_CLASS(plugin, base) static_assert(std::is_base_of<base, plugin>::value, "");
