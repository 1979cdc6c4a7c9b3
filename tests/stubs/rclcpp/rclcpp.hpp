// As much of rclcpp as exported plugins use: services and topics are called by the test, through `Node::last`.
#pragma once
#include <functional>
#include <memory>
#include <string>

namespace rclcpp
{
template <typename T>
struct Service
{
    using SharedPtr = std::shared_ptr<Service>;
};

template <typename T>
struct Subscription
{
    using SharedPtr = std::shared_ptr<Subscription>;
};

class Node
{
public:
    using SharedPtr = std::shared_ptr<Node>;
    static inline Node *last = nullptr;
    std::function<void()> call;
    std::function<void(double)> publish;

    explicit Node(const std::string &) { last = this; }

    template <typename T, typename F>
    typename Service<T>::SharedPtr create_service(const std::string &, F callback)
    {
        call = [callback] {
            callback(std::make_shared<typename T::Request>(), std::make_shared<typename T::Response>());
        };
        return std::make_shared<Service<T>>();
    }

    template <typename T, typename F>
    typename Subscription<T>::SharedPtr create_subscription(const std::string &, int, F callback)
    {
        publish = [callback](double value) {
            T said;
            said.data = value;
            callback(said);
        };
        return std::make_shared<Subscription<T>>();
    }
};

namespace executors
{
struct SingleThreadedExecutor
{
    void add_node(const Node::SharedPtr &) {}
    void spin() {}
    void cancel() {}
};
}  // namespace executors
}  // namespace rclcpp
