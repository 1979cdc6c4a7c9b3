// As much of rclcpp as the node in docs/ uses.
#pragma once
#include <functional>
#include <memory>
#include <string>

namespace rclcpp
{
template <class Message>
struct Publisher {
    using SharedPtr = std::shared_ptr<Publisher>;
    void publish(const Message &) {}
};
template <class Message>
struct Subscription {
    using SharedPtr = std::shared_ptr<Subscription>;
};
struct Node {
    explicit Node(const std::string &) {}
    template <class Message>
    typename Publisher<Message>::SharedPtr create_publisher(const std::string &, int)
    {
        return std::make_shared<Publisher<Message>>();
    }
    template <class Message>
    typename Subscription<Message>::SharedPtr create_subscription(
        const std::string &, int, std::function<void(const Message &)>)
    {
        return std::make_shared<Subscription<Message>>();
    }
};
inline void init(int, char **) {}
inline void spin(std::shared_ptr<Node>) {}
inline void shutdown() {}
}  // namespace rclcpp
